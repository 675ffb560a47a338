"""Rays against triangles, by embree: nothing but synthetic scans needs it."""

from typing import TYPE_CHECKING

from trimesh import Trimesh

from planfit.errors import OptionError

if TYPE_CHECKING:
    from trimesh.ray.ray_pyembree import RayMeshIntersector


def ray_caster(mesh: Trimesh) -> "RayMeshIntersector":
    """What finds the triangle that each ray meets first.

    Raises:
        OptionError: embree is not there, as on platforms that it has no wheel for.
    """
    try:
        from trimesh.ray.ray_pyembree import RayMeshIntersector
    except ImportError as error:
        raise OptionError(
            f"synthetic scans: expected the library embreex, found none that works here ({error}); "
            "pip install embreex where it has a wheel (Linux and Windows x86-64, macOS). "
            "All else of planfit works without it"
        ) from error
    return RayMeshIntersector(mesh)
