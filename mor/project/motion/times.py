"""Times as people write them, in years."""

from __future__ import annotations

import re
from datetime import datetime

_YEAR = re.compile(r"[12]\d{3}(\.\d+)?")
_MONTH = re.compile(r"[12]\d{3}-\d{2}")


def decimal_year(text: str) -> float:
    """Year and part of that year behind 2015-05-12, 2015-05-12T14:30, 2015-05 (its first day) or 2015.36.

    Raises ``ValueError`` with what was found and what was expected.
    """
    if _YEAR.fullmatch(text):
        return float(text)
    try:
        moment = datetime.fromisoformat(f"{text}-01" if _MONTH.fullmatch(text) else text).replace(tzinfo=None)
    except ValueError:
        words = f"found {text!r}, expected a date such as 2015-05-12, or a year such as 2015.36"
        raise ValueError(words) from None
    begin = datetime(moment.year, 1, 1)
    whole = datetime(moment.year + 1, 1, 1) - begin
    return moment.year + (moment - begin) / whole
