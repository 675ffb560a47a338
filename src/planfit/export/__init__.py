"""Results as files: poses, trajectory, record of the run, point clouds, meshes, data sets, plans."""

from planfit.export.cloud import sample_cloud as sample_cloud
from planfit.export.record import make_record as make_record
from planfit.export.run_folder import RunFolder as RunFolder
from planfit.export.run_folder import finished_record as finished_record
from planfit.export.run_folder import inputs_of_owner as inputs_of_owner
from planfit.export.write import write_results as write_results
