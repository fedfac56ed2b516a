"""Put plotly.js, which draws the charts of the page, into the package; its Python classes are not needed."""

from __future__ import annotations

import base64
import zlib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class ChartLibrary(BuildHookInterface[Any]):
    """Packs the script from the package ``plotly`` of the build environment (MIT licence)."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write it, packed as the page has it, beside the other assets: for wheels, archives and editable installs."""
        spec = find_spec("plotly")
        assert spec is not None
        assert spec.origin is not None
        script = Path(spec.origin).parent / "package_data" / "plotly.min.js"
        packed = base64.b64encode(zlib.compress(script.read_bytes(), 4))
        (Path(self.root) / "mor" / "report" / "assets" / "plotly.b64").write_bytes(packed)
