"""The Python examples of README.md and of pages in docs run as they are printed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = (
    "README.md",
    "docs/start.md",
    "docs/environments.md",
    "docs/skills.md",
    "docs/seeing.md",
    "docs/predictors.md",
)
EXAMPLES = [
    (page, number, code)
    for page in PAGES
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL))
]


def test_every_page_has_examples():
    assert [sum(page == name for page, _, _ in EXAMPLES) for name in PAGES] == [2, 1, 3, 2, 1, 2]


@pytest.mark.parametrize(
    ("page", "number", "code"), EXAMPLES, ids=[f"{page}-{number}" for page, number, _ in EXAMPLES]
)
def test_example_runs(page, number, code):
    exec(compile(code, f"{page}, example {number + 1}", "exec"), {})
