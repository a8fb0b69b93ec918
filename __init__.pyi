# Public names, by the module that each comes from: one line here makes a name public.
# `name as name` marks what is exported.

from .bench.datasets.export import export as export
from .bench.datasets.predictions import PredictionErrors as PredictionErrors
from .bench.datasets.published_sets import score_published as score_published
from .bench.datasets.render import render_dataset as render_dataset
from .bench.datasets.score import score_dataset as score_dataset
from .bench.learning.options import TrainingOptions as TrainingOptions
from .bench.public.captures import run_captures as run_captures
from .bench.public.doctor import doctor as doctor, self_check as self_check
from .bench.public.gates import (
    BaselineUpdate as BaselineUpdate,
    GateResult as GateResult,
    gate as gate,
    update_baseline as update_baseline,
)
from .bench.public.lists import (
    list_lights as list_lights,
    list_maps as list_maps,
    list_materials as list_materials,
    list_metals as list_metals,
    list_methods as list_methods,
    list_metrics as list_metrics,
    list_patterns as list_patterns,
    list_sensors as list_sensors,
    list_shapes as list_shapes,
    list_studies as list_studies,
    list_suites as list_suites,
    list_surfaces as list_surfaces,
    list_swatches as list_swatches,
)
from .bench.public.report import report as report
from .bench.public.suites import Plan as Plan, plan as plan, run as run
from .bench.public.tables import compare as compare, table as table
from .bench.public.train import ablate as ablate, train as train
from .bench.running.capture_suite import (
    CaptureEntry as CaptureEntry,
    CaptureSuite as CaptureSuite,
    load_captures as load_captures,
)
from .bench.running.results import Results as Results, read_results as read_results
from .bench.running.status import Status as Status, status as status
from .bench.scoring.capture_score import score_capture as score_capture
from .bench.scoring.judge import Score as Score
from .bench.scoring.observe import observe as observe
from .bench.scoring.score import score as score
from .bench.studies.registry import run_study as run_study
from .bench.studies.study import Findings as Findings, Study as Study
from .reconstruct import (
    ChainResult as ChainResult,
    Components as Components,
    GivenParameters as GivenParameters,
    Illuminant as Illuminant,
    Inapplicable as Inapplicable,
    Method as Method,
    Observation as Observation,
    RecoveredShape as RecoveredShape,
    Separation as Separation,
    SurfaceParameters as SurfaceParameters,
    blind as blind,
    estimate_direction as estimate_direction,
    estimate_illuminant as estimate_illuminant,
    fit_parameters as fit_parameters,
    get_method as get_method,
    illuminants as illuminants,
    methods as methods,
    paper as paper,
    polarisation_ratio as polarisation_ratio,
    recover_shape as recover_shape,
    run_chain as run_chain,
    run_paper as run_paper,
    separate as separate,
    separations as separations,
    specular_dolp as specular_dolp,
)
from .reconstruct.photos.capture import Capture as Capture, read_capture as read_capture
from .reconstruct.photos.capture_fit import CaptureFit as CaptureFit, fit_capture as fit_capture
from .reconstruct.photos.filter import (
    FilteredPicture as FilteredPicture,
    FilterOutput as FilterOutput,
    filter_picture as filter_picture,
)
from .reconstruct.photos.knowledge import Knowledge as Knowledge, read_knowledge as read_knowledge
from .reconstruct.photos.picture import Picture as Picture
from .reconstruct.photos.read_picture import read_picture as read_picture
from .reconstruct.photos.sensor_stokes import demosaiced_stokes as demosaiced_stokes
from .renderers import Truth as Truth, render as render
from .renderers.datasets.dataset import Dataset as Dataset
from .renderers.datasets.opened import open_dataset as open_dataset
from .renderers.datasets.samples import Samples as Samples
from .scenes import (
    Area as Area,
    Blob as Blob,
    Camera as Camera,
    Checker as Checker,
    Conductor as Conductor,
    Crease as Crease,
    Dielectric as Dielectric,
    Distant as Distant,
    Environment as Environment,
    ImageTexture as ImageTexture,
    InputError as InputError,
    Interior as Interior,
    Lathe as Lathe,
    Light as Light,
    Measured as Measured,
    MeshFile as MeshFile,
    Noise as Noise,
    Patterned as Patterned,
    Placed as Placed,
    Plane as Plane,
    Polariser as Polariser,
    Sampling as Sampling,
    Scene as Scene,
    Shape as Shape,
    Sky as Sky,
    SkyPolarisation as SkyPolarisation,
    Sphere as Sphere,
    Spots as Spots,
    Stripes as Stripes,
    Suite as Suite,
    Superquadric as Superquadric,
    Surroundings as Surroundings,
    Torus as Torus,
    Uniform as Uniform,
    Views as Views,
    load_suite as load_suite,
    suite_names as suite_names,
)
from .scenes.sensor import Sensor as Sensor
from .scenes.sensor_frame import SensorFrame as SensorFrame, expose as expose

__all__: list[str]
__version__: str
