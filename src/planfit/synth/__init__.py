"""Synthetic buildings, walks through them, and what a depth camera and odometry make of these."""

from planfit.synth.building import Building as Building
from planfit.synth.building import facap_segments as facap_segments
from planfit.synth.building import make_building as make_building
from planfit.synth.facap import write_facap as write_facap
from planfit.synth.mesh import make_lights as make_lights
from planfit.synth.mesh import make_quads as make_quads
from planfit.synth.options import BuildingOptions as BuildingOptions
from planfit.synth.options import CameraOptions as CameraOptions
from planfit.synth.options import DriftOptions as DriftOptions
from planfit.synth.options import NoDepthNoise as NoDepthNoise
from planfit.synth.options import StructuredLightNoise as StructuredLightNoise
from planfit.synth.options import SynthOptions as SynthOptions
from planfit.synth.options import TimeOfFlightNoise as TimeOfFlightNoise
from planfit.synth.options import WalkOptions as WalkOptions
from planfit.synth.plan_building import PlanBuilding as PlanBuilding
from planfit.synth.render import Renderer as Renderer
from planfit.synth.render import View as View
from planfit.synth.scan import SyntheticScan as SyntheticScan
from planfit.synth.scan import make_camera as make_camera
from planfit.synth.scan import make_scan as make_scan
from planfit.synth.sensor_noise import drift_poses as drift_poses
from planfit.synth.sensor_noise import noisy_depth as noisy_depth
from planfit.synth.storeys import ON_STAIRS as ON_STAIRS
from planfit.synth.storeys import StoreyedBuilding as StoreyedBuilding
from planfit.synth.storeys import make_storeys as make_storeys
from planfit.synth.walk import walk_through as walk_through
