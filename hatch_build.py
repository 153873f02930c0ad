"""Build hook: a wheel contains the files of other projects that the pages use."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

VENDOR = "bench/web/static/vendor"


class FetchAssets(BuildHookInterface[Any]):
    """Fetches them before a wheel is built; an editable install takes them from `make assets`."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Fetch the files and add them to the wheel."""
        if version == "editable":
            return
        source = importlib.util.spec_from_file_location("assets", Path(self.root) / "bench/web/assets.py")
        assert source is not None  # noqa: S101  the file is part of every source
        assert source.loader is not None  # noqa: S101
        assets = importlib.util.module_from_spec(source)
        source.loader.exec_module(assets)
        assets.fetch(with_tests=False)
        build_data["force_include"][str(Path(self.root) / VENDOR)] = VENDOR
