"""The report of a reproduction: one page that opens from disk and needs nothing but itself.

The same folder gives the same page: it holds no times but those that were measured.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from string import Template

from hpp_framework.reproduction.report_answer import answer_section
from hpp_framework.reproduction.report_data import REPORT, Reproduction, read_reproduction
from hpp_framework.reproduction.report_episodes import ShownCell, shown_cells
from hpp_framework.reproduction.report_html import Markup, escaped, join, tag
from hpp_framework.reproduction.report_paper import CITATION
from hpp_framework.reproduction.report_sections import (
    appendix_section,
    claims_section,
    films_section,
    main_section,
    ours_section,
    paper_section,
    predictors_section,
)
from hpp_framework.reproduction.report_svg import with_own_names
from hpp_framework.utils.errors import ConfigError
from hpp_framework.utils.run_folder import replacing

PAGE = "index.html"
TEMPLATE = Path(__file__).with_name("report_page.html")
TITLE = "Hierarchical predictive planning, reproduced"

_PARTS = {
    "answer": "Answer", "claims": "Claims", "comparison": "Comparison", "paper": "The paper's figures",
    "episodes": "Episodes", "ablations": "Ablations", "predictors": "Predictors", "appendix": "Repeat it",
}  # fmt: skip


def write_report(out: Path, *, films: bool = True, say: Callable[[str], None] = lambda _: None) -> Path:
    """Write the report of what a reproduction has left so far; what is missing is shown as not run.

    Args:
        out: folder of the reproduction, with its ``plan.json``.
        films: whether chosen episodes are filmed; that runs their cells once more, the first time.
        say: called with lines for the user.

    Returns:
        The page, ``OUT/report/index.html``.

    Raises:
        ConfigError: if the folder holds no plan, a file in it is damaged, or the page cannot be written.
    """
    found = read_reproduction(out)
    main = found.main
    cells = shown_cells(main, out, say) if films and main is not None and main.rows("cells") else []
    page = Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=escaped(TITLE), head=_head(found), nav=_nav(), body=with_own_names(_body(found, cells))
    )
    file = out / REPORT / PAGE
    try:
        with replacing(file) as temporary:
            temporary.write_text(page, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"'{file}' could not be written: {error.strerror or error}.") from error
    return file


def _head(found: Reproduction) -> Markup:
    version = found.versions.get("hpp-framework", "")
    return join(
        tag("h1", TITLE),
        tag("p", f"{CITATION}, checked claim by claim on the same episodes for every planner."),
        tag("p", f"Scale {found.scale}, seed {found.seed}, hpp-framework {version}", class_="meta"),
    )


def _nav() -> Markup:
    return tag("ul", *(tag("li", tag("a", title, href=f"#{name}")) for name, title in _PARTS.items()))


def _body(found: Reproduction, cells: list[ShownCell]) -> Markup:
    return join(
        answer_section(found), claims_section(found), main_section(found.main), paper_section(found),
        films_section(cells), ours_section(found), predictors_section(found), appendix_section(found),
    )  # fmt: skip
