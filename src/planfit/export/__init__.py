"""Results as files: poses, trajectory, record of the run, point clouds, meshes, data sets, plans."""
