"""A table of a project file: its rows, or the file they stand in, its columns and units."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, StringConstraints, model_validator

from mor.project.file.scalars import Strict, Text, one_sign

_SAID = {"file": "a file", "direction": "a direction", "surface": "a surface"}


class Table(Strict):
    """Rows, here or in a file beside the project."""

    name: Text | None = Field(default=None, description="Name in reports; default the file or the type")
    file: Text | None = Field(
        default=None,
        description="CSV (may be .gz), Parquet or spreadsheet (.xlsx, .ods), relative to the project file",
    )
    rows: list[list[str | None]] | None = Field(
        default=None, description="Rows in place, in the order of columns"
    )
    columns: list[Text | None] | dict[str, Text | None] | None = Field(
        default=None,
        description="A list declares the columns of rows or of a file without header (null skips one); "
        "a mapping renames columns of a file with header (null skips one)",
    )
    values: dict[str, Text] = Field(
        default_factory=dict, description="Columns with the same value in every row"
    )
    units: Text | dict[str, Text] = Field(default_factory=dict, description="Units by column, or one for all")
    delimiter: (
        Annotated[
            str,
            StringConstraints(strip_whitespace=False, min_length=1, max_length=1),
            AfterValidator(one_sign),
        ]
        | None
    ) = Field(
        default=None, description="Between columns of a CSV file; a blank stands for any number of blanks"
    )
    decimal: Literal[".", ","] = Field(default=".", description="Decimal sign of the numbers in the file")
    sheet: Text | None = Field(
        default=None, description="Sheet of a spreadsheet; needed if several sheets hold something"
    )

    @model_validator(mode="after")
    def _one_source(self) -> Table:
        given = [key for key, value in self.sources.items() if value is not None]
        if len(given) != 1:
            *others, last = (_SAID.get(key, key) for key in self.sources)
            raise ValueError(f"give either {', '.join(others)} or {last}")
        if self.rows is not None and not isinstance(self.columns, list):
            raise ValueError("rows need a list of columns")
        if given[0] not in ("file", "rows") and (self.columns is not None or self.delimiter is not None):
            raise ValueError(f"columns and delimiter belong to a file or rows, not to {given[0]}")
        if self.file is None and (self.decimal != "." or self.sheet is not None):
            raise ValueError("decimal and sheet belong to a file")
        if self.decimal == "," and self.delimiter in (None, ","):
            raise ValueError(
                "numbers with a decimal comma need another delimiter than a comma: say delimiter: ;"
            )
        return self

    @property
    def sources(self) -> dict[str, object]:
        """What the rows may come from, by its key; ``None`` if it is not given."""
        return {"file": self.file, "rows": self.rows}
