"""Open3D without its views for notebooks: dash and plotly, which nothing here needs, are half of what its import takes."""

import sys
from types import ModuleType

UNUSED = ("dash", "plotly", "plotly.graph_objects")


def _nothing(name: str) -> ModuleType:
    """A module of which anything can be imported."""
    made = ModuleType(name)
    made.__getattr__ = lambda attribute: None  # type: ignore[method-assign]
    return made


_stood_in = {name: _nothing(name) for name in UNUSED if name not in sys.modules}
sys.modules.update(_stood_in)
try:
    import open3d
finally:
    for _name in _stood_in:
        del sys.modules[_name]

__all__ = ["open3d"]
