"""What stands at the leaves of a project file: texts, names, measures, delimiters; and the base of all sections."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


def _one_line(text: str) -> str:
    if any(sign in text for sign in "\n\r\0"):
        raise ValueError(f"found {text!r}, expected a text without line breaks")
    return text


Text = Annotated[str, Field(min_length=1), AfterValidator(_one_line)]
Measure = Annotated[
    str,
    Field(
        pattern=r"^\s*[-+]?(\d+-\d+(-\d+\.?\d*)?|(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?(\s*[A-Za-zµμ%°/\-]+[0-9^]*)?)\s*$",
        description="A number, with or without a unit: 28.8, 0.5 um, 3 mgon; an angle in dms: 12-34-56.7",
    ),
]
Name = Annotated[
    str,
    Field(min_length=1, description="An identifier; always text, whatever it looks like"),
    AfterValidator(_one_line),
]


def one_sign(sign: str) -> str:
    """A sign that can stand between the cells of a table; ValueError where it cannot."""
    if not re.fullmatch(r"[\t !$%&'()*,/:;<=>?@\[\\\]^_`{|}~]", sign):
        raise ValueError(
            f"found {sign!r}, expected one sign that is in no number and no name, such as ; or a tab"
        )
    return sign


class Strict(BaseModel):
    """Unknown keys are errors, nothing changes after reading.

    Validators are built by their first use, which most sections of a file never see; so a section that stands for one
    that is missing is made by ``model_construct``, which needs none.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, str_strip_whitespace=True, defer_build=True
    )
