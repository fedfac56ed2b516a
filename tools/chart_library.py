"""Put plotly.js, which draws the charts of the page, into the package; its Python classes are not needed."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ChartLibrary(BuildHookInterface[Any]):
    """Copies the script from the package ``plotly`` of the build environment (MIT licence)."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Copy it beside the other assets of the page, for wheels, source distributions and editable installations."""
        spec = find_spec("plotly")
        assert spec is not None
        assert spec.origin is not None
        script = Path(spec.origin).parent / "package_data" / "plotly.min.js"
        shutil.copyfile(script, Path(self.root) / "mor" / "report" / "assets" / script.name)
