"""Large meshes are made of tiles: nothing is lost between them, nothing is there twice."""

import numpy as np
import pytest
import trimesh

import planfit.export.mesh as mesh_module
from planfit.export.mesh import BLOCK_VOXELS, SUFFIXES, cut_tiles, fuse_mesh, write_mesh
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

VOXEL_M, MAX_DEPTH_M, TRUNCATION_M = 0.05, 5.0, 0.2


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=2,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=24),
            camera=CameraOptions(width_px=160, height_px=120),
        )
    )


def tiles_of(synthetic, max_blocks):
    poses = synthetic.true_world_from_cams
    return cut_tiles(synthetic.scan, poses, VOXEL_M, MAX_DEPTH_M, TRUNCATION_M, max_blocks)


def seen_points(synthetic, i):
    depth = synthetic.scan.files.depth(i)
    points = synthetic.scan.cameras[i].lift_image(np.where(depth < MAX_DEPTH_M, depth, np.nan))
    points = points.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    return se3.transform(synthetic.true_world_from_cams[i], points)


@pytest.mark.parametrize("max_blocks", [30, 100, 10**6])
def test_tiles_fill_space_and_know_who_sees_them(max_blocks, synthetic):
    tiles = tiles_of(synthetic, max_blocks)
    assert (len(tiles) == 1) == (max_blocks == 10**6)
    block_m = BLOCK_VOXELS * VOXEL_M
    anywhere = np.random.default_rng(0).uniform(-60, 60, (5000, 3))
    owners = np.sum([tile.owns(anywhere, block_m) for tile in tiles], axis=0)
    assert (owners == 1).all()
    for i in range(0, 24, 5):
        points = seen_points(synthetic, i)
        for tile in tiles:
            # Stray pixels between those that are looked at may be in a block of their own.
            if tile.owns(points, block_m).mean() > 0.01:
                assert i in tile.frame_idx
    counts = []
    for tile in tiles:
        own = [
            p[tile.owns(p, block_m)] for p in (seen_points(synthetic, i) for i in tile.frame_idx)
        ]
        counts.append(len(np.unique(np.floor(np.concatenate(own) / block_m), axis=0)))
    assert max(counts) <= max_blocks


def test_no_depth_that_is_near_enough(synthetic):
    poses = synthetic.true_world_from_cams
    assert cut_tiles(synthetic.scan, poses, VOXEL_M, 0.01, TRUNCATION_M) == []


def test_a_mesh_of_tiles_is_the_mesh_of_the_whole(synthetic, monkeypatch):
    reason = "Open3D is not installed, or a library of the system that it needs"
    pytest.importorskip("open3d", reason=reason, exc_type=ImportError)

    def fuse():
        runtime = Runtime(1, None, None)
        return fuse_mesh(
            synthetic.scan, synthetic.true_world_from_cams, VOXEL_M, MAX_DEPTH_M, runtime
        )

    whole = fuse()
    monkeypatch.setattr(mesh_module, "cut_tiles", lambda *a: cut_tiles(*a, max_blocks=60))
    tiled = fuse()
    assert len(tiles_of(synthetic, 60)) > 3
    assert len(tiled.faces) == pytest.approx(len(whole.faces), rel=0.002)
    assert len(tiled.vertices) == pytest.approx(len(whole.vertices), rel=0.002)
    assert tiled.area == pytest.approx(whole.area, rel=0.002)


def test_a_mesh_on_a_national_grid_is_the_mesh_at_home(synthetic):
    """Single precision has steps of half a metre at the northings of a national grid."""
    pytest.importorskip("open3d", reason="Open3D is not installed", exc_type=ImportError)
    grid = np.array([691_000.0, 5_335_000.0, 515.0])
    poses = synthetic.true_world_from_cams
    there = poses.copy()
    there[:, :3, 3] += grid
    home, away = (
        fuse_mesh(synthetic.scan, each, VOXEL_M, MAX_DEPTH_M, Runtime(1, None, None))
        for each in (poses, there)
    )
    # Voxels begin at another place by less than one of them.
    assert away.area == pytest.approx(home.area, rel=0.01)
    np.testing.assert_allclose(away.bounds - grid, home.bounds, atol=VOXEL_M)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (691_000.25, 5_335_000.5, 515.0)])
def test_files_of_meshes_lose_nothing_wherever_they_are(tmp_path, suffix, origin):
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    mesh.visual.vertex_colors = np.arange(4 * len(mesh.vertices)).reshape(-1, 4).astype(np.uint8)
    mesh.apply_translation(origin)
    write_mesh(tmp_path / f"mesh{suffix}", mesh, suffix)
    read = trimesh.load(tmp_path / f"mesh{suffix}", process=False)
    read = read.to_geometry() if isinstance(read, trimesh.Scene) else read
    np.testing.assert_allclose(read.vertices, mesh.vertices, atol=1e-4, rtol=0)
    np.testing.assert_array_equal(read.faces, mesh.faces)
    np.testing.assert_array_equal(
        read.visual.vertex_colors[:, :3], mesh.visual.vertex_colors[:, :3]
    )
