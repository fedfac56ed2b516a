"""Tables of results: data frames that know their units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class Table:
    """A data frame and the units of its columns.

    Attributes:
        frame: the polars data frame, in axes and units of the project.
        units: unit of each column that has one; ``"unit"`` where each row has its own, in the column ``unit``.
    """

    frame: pl.DataFrame
    units: Mapping[str, str]

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return self.frame.columns

    def __len__(self) -> int:
        return self.frame.height

    def __getitem__(self, column: str) -> pl.Series:
        return self.frame[column]

    def row(self, name: str) -> dict[str, Any]:
        """The row of a thing by its name. Raises ``KeyError``, with the nearest name."""
        from mor.errors import nearest

        found = self.frame.filter(self.frame["id"] == name)
        if found.height == 0:
            raise KeyError(f"nothing here is called {name!r}{nearest(name, self.frame['id'].to_list())}")
        return found.row(0, named=True)

    def to_pandas(self) -> Any:
        """The table as a pandas data frame, with the units in its ``attrs``; pandas must be installed."""
        import pandas

        result = pandas.DataFrame({name: self.frame[name].to_list() for name in self.frame.columns})
        result.attrs["units"] = dict(self.units)
        return result

    def __str__(self) -> str:
        return str(self.frame)

    def _repr_html_(self) -> str:
        """Return the first rows, with units in the headings, for notebooks."""
        shown = self.frame.head(20)
        heads = "".join(f"<th>{escape(self._head(name))}</th>" for name in shown.columns)
        rows = "".join(
            f"<tr>{''.join(f'<td>{escape(_cell(value))}</td>' for value in row)}</tr>" for row in shown.rows()
        )
        more = self.frame.height - shown.height
        rest = f"<p>… {more} more rows</p>" if more > 0 else ""
        return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>{rest}"

    def _head(self, name: str) -> str:
        unit = self.units.get(name)
        return name if unit is None or unit == "unit" else f"{name} [{unit}]"


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.7g}" if isinstance(value, float) else str(value)
