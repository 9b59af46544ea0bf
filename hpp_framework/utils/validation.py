"""Values checked by pydantic: kinds of numbers, configs that check themselves, one text for mistakes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import wraps
from typing import Annotated, Any, TypeVar, dataclass_transform, get_args

from pydantic import AfterValidator, BeforeValidator, Field, StrictBool, StringConstraints, ValidationError
from pydantic.dataclasses import dataclass as pydantic_dataclass
from pydantic_core import ErrorDetails, PydanticCustomError

from hpp_framework.utils.errors import ConfigError, suggest

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
NonPositive = Annotated[float, Field(strict=True, le=0, allow_inf_nan=False)]
Share = Annotated[
    float, Field(strict=True, ge=0, le=1, allow_inf_nan=False, description="It is a share between 0 and 1.")
]
Whole = Annotated[int, Field(strict=True, ge=0)]
Count = Annotated[int, Field(strict=True, ge=1)]
Several = Annotated[int, Field(strict=True, ge=2)]
Flag = StrictBool
Text = Annotated[str, StringConstraints(strict=True, strip_whitespace=True, min_length=1)]

UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
"""Types of errors about names that are not known; told first, for a misspelt name is missing besides."""

Built = TypeVar("Built")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def validated(cls: type[Built]) -> type[Built]:
    """Make a frozen, keyword-only dataclass that refuses values its annotations do not allow.

    Its constructor raises :class:`ConfigError` instead of pydantic's own error, with the description of the
    field if it has one. Whole numbers become floats where a float is asked for.
    """
    made: Any = pydantic_dataclass(
        frozen=True, kw_only=True, config={"extra": "forbid", "arbitrary_types_allowed": True}
    )(cls)
    build = made.__init__

    @wraps(build)
    def init(self: Any, *args: Any, **kwargs: Any) -> None:
        try:
            build(self, *args, **kwargs)
        except ValidationError as error:
            raise explained(error, made, _called(cls)) from error

    made.__init__ = init
    return made


def mistake(problem: str, remedy: str, key: str = "") -> PydanticCustomError:
    """Build an error that validators raise.

    Args:
        problem: what is wrong, to follow the key.
        remedy: what would be right, a sentence.
        key: of the mistake inside the value that the validator checks.
    """
    return PydanticCustomError("mistake", "{problem}", {"problem": problem, "remedy": remedy, "key": key})


def numbers(*names: str) -> BeforeValidator:
    """Return a check that a value lists as many numbers as there are names."""

    def check(value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != len(names):
            raise mistake(
                f"must be a list of {len(names)} numbers, got {show(value)}", f"Write [{', '.join(names)}]."
            )
        return tuple(value)

    return BeforeValidator(check)


def filled(remedy: str) -> AfterValidator:
    """Return a check that a list has entries."""

    def check(value: Sequence[Any]) -> Sequence[Any]:
        if not value:
            raise mistake("is empty", remedy)
        return value

    return AfterValidator(check)


def _listed(value: Any) -> Any:
    if value is not None and not isinstance(value, list | tuple):
        raise mistake(f"must be a list, got {show(value)}", "Begin each entry on its own line with '- '.")
    return tuple(value or ())


LISTED = BeforeValidator(_listed)
"""Takes a list where a tuple is kept; nothing is an empty one."""


def explained(error: ValidationError, model: Any, where: object) -> ConfigError:
    """Return the project's error for pydantic's: where, what, and what would be right.

    Args:
        error: of which one mistake is told, the first unless there is an unknown name.
        model: the model or dataclass that was validated.
        where: the file or the config.
    """
    told = min(error.errors(include_url=False), key=lambda each: each["type"] not in UNKNOWN)
    fields = _fields(model, told["loc"])
    problem, remedy = _words(told, fields)
    about = [fields[part].description for part in map(str, told["loc"]) if part in fields][-1:]
    key = joined(*told["loc"], *filter(None, [told.get("ctx", {}).get("key")]))
    words = [f"{where}:", f"'{key}'" if key else "", f"{problem}.", remedy, *about]
    return ConfigError(" ".join(filter(None, words)))


def joined(*parts: str | int) -> str:
    """Return the path of a key inside others, e.g. ``members[0].leaves_at``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")


def show(value: object) -> str:
    """Return a value in short, for messages."""
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def unknown(name: str, known: Sequence[str]) -> str:
    """Return the remedy for an unknown name."""
    return f"{suggest(name, known)} Known here: {', '.join(known)}.".strip()


def _words(told: ErrorDetails, fields: dict[str, Any]) -> tuple[str, str]:
    """Return problem and remedy.

    Args:
        told: the mistake.
        fields: beside the one it is about, or, where that is itself a model, in it.
    """
    value, limits, got = told["input"], told.get("ctx", {}), show(told["input"])
    required = [name for name, field in fields.items() if field.is_required()]
    match told["type"]:
        case "mistake":
            return limits["problem"], limits["remedy"]
        case "extra_forbidden" | "unexpected_keyword_argument":
            return "is not a known key", unknown(str(told["loc"][-1]), list(fields))
        case "missing" | "missing_keyword_only_argument":
            return "is missing", f"Add it; required here: {', '.join(required)}."
        case "model_type" | "dataclass_type" | "dict_type" | "mapping_type":
            return f"must be a mapping, got {got}", f"Keys: {', '.join(fields)}." if fields else ""
        case "finite_number":
            return f"must be finite, got {got}", "Use a plain number, e.g. 1.5."
        case "greater_than":
            remedy = "Use a positive number." if limits["gt"] == 0 else f"Use more than {limits['gt']:g}."
            return f"must be greater than {limits['gt']:g}, got {got}", remedy
        case "greater_than_equal":
            return f"must be at least {limits['ge']:g}, got {got}", f"Use {limits['ge']:g} or more."
        case "less_than_equal":
            return f"must be at most {limits['le']:g}, got {got}", f"Use {limits['le']:g} or less."
        case "float_type" | "float_parsing":
            return f"must be a number, got {got}", _number_remedy(value)
        case "int_type" | "int_parsing" | "int_from_float":
            return f"must be a whole number, got {got}", "Write it without a decimal point, unquoted: 5."
        case "bool_type" | "bool_parsing":
            return f"must be true or false, got {got}", "Write true or false, unquoted."
        case "string_type" | "string_too_short":
            return f"must be text, got {got}", "Put it in quotes."
        case "literal_error":
            choices = re.findall("'([^']*)'", limits["expected"])
            return f"must be {limits['expected']}, got {got}", suggest(str(value), choices).strip()
        case _:
            return f"is wrong: {told['msg']}, got {got}", ""


def _number_remedy(value: object) -> str:
    if isinstance(value, str):
        return "Write it unquoted and without a unit, with a decimal point before an exponent: 1.0e-2."
    return "Write one number, e.g. 1.5."


def _fields(model: Any, location: Sequence[str | int]) -> dict[str, Any]:
    """Return the fields, as files call them, of the innermost model on the path to a value."""
    found = {field.alias or name: field for name, field in model.__pydantic_fields__.items()}
    inner = next((part for part in location if part in found), None)
    within = inner is not None and _model(found[str(inner)].annotation)
    return _fields(within, location[location.index(inner) + 1 :]) if within else found


def _model(annotation: Any) -> Any:
    """Return the model or dataclass that an annotation is made of, None if there is none."""
    if hasattr(annotation, "__pydantic_fields__"):
        return annotation
    return next(filter(None, map(_model, get_args(annotation))), None)


def _called(cls: type) -> str:
    """Return what a config is called in messages, e.g. ``lattice`` for ``LatticeConfig``."""
    name = re.sub("(Config|Model|Spec)$", "", cls.__name__)
    return re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()
