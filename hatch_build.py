"""What a wheel holds besides the package: the pages that `planfit help` shows, and kernels.

Which wheel is built: without compiled kernels, for every system (py3-none-any), or with them, for one.

    python -m build                                  without: numba compiles them at their first call
    PLANFIT_KERNELS=FOLDER python -m build --wheel   with those in FOLDER, made by planfit doctor --compile

A wheel with them has the tag of the numba that compiled them. Kernels of other sources are an error.
"""

import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGE = Path("src/planfit")
READY = "compiled/ready"


class KernelsHook(BuildHookInterface):
    """Takes compiled kernels into a wheel where the environment names them."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add files and a tag to what is built.

        Raises:
            ValueError: the folder has no kernels, or has those of other sources.
        """
        folder = os.environ.get("PLANFIT_KERNELS")
        if version != "standard":  # an editable installation is its sources
            return
        for page in (Path(self.root) / "docs").glob("*.md"):  # for planfit help
            build_data["force_include"][str(page)] = f"planfit/pages/{page.name}"
        if not folder:
            self.app.display_info(
                "no compiled kernels in this wheel: numba compiles them at their first call "
                "(PLANFIT_KERNELS, hatch_build.py)"
            )
            return
        package = Path(self.root) / PACKAGE
        files = _module(package / "compiled" / "ready_files.py")
        ready = files.read_ready(Path(folder))
        if isinstance(ready, str):
            raise ValueError(f"PLANFIT_KERNELS={folder}: {ready}")
        if ready.made.source != files.source_digest(package):
            raise ValueError(
                f"PLANFIT_KERNELS={folder}: made for other sources of planfit than these"
            )
        if not ready.wheel_tag:
            raise ValueError(f"PLANFIT_KERNELS={folder}: made by a numba without a wheel's tag")
        for name in (files.INDEX, files.BLOBS):
            build_data["force_include"][str(Path(folder).resolve() / name)] = (
                f"planfit/{READY}/{name}"
            )
        build_data["pure_python"] = False
        build_data["tag"] = ready.wheel_tag


def _module(path: Path) -> Any:
    """A module of planfit by itself: the package needs more than a build has."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module
