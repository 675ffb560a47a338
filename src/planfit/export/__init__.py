"""Results as files: poses, trajectory, record of the run, point clouds, meshes, data sets, plans."""

from planfit.export.cloud import sample_cloud as sample_cloud
from planfit.export.record import make_record as make_record
from planfit.export.write import write_results as write_results
