"""Synthetic ground truth for methods that tell polarisation from one unpolarised image.

Everything that the command line does is here as a function that returns values and prints nothing:
`malus.run("quick", out="results/quick")`. Names are imported when they are first used.
"""

# `name as name` marks what is exported; one such import a line would be a hundred lines.
# ruff: noqa: I001

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from malus.bench.datasets.export import export as export
    from malus.bench.datasets.predictions import PredictionErrors as PredictionErrors
    from malus.bench.datasets.published_sets import score_published as score_published
    from malus.bench.datasets.render import render_dataset as render_dataset
    from malus.bench.datasets.score import score_dataset as score_dataset
    from malus.bench.learning.options import TrainingOptions as TrainingOptions
    from malus.bench.public.captures import run_captures as run_captures
    from malus.bench.public.doctor import doctor as doctor, self_check as self_check
    from malus.bench.public.gates import (
        BaselineUpdate as BaselineUpdate,
        GateResult as GateResult,
        gate as gate,
        update_baseline as update_baseline,
    )
    from malus.bench.public.lists import (
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
    from malus.bench.public.report import report as report
    from malus.bench.public.suites import Plan as Plan, plan as plan, run as run
    from malus.bench.public.tables import compare as compare, table as table
    from malus.bench.public.train import ablate as ablate, train as train
    from malus.bench.running.capture_suite import (
        CaptureEntry as CaptureEntry,
        CaptureSuite as CaptureSuite,
        load_captures as load_captures,
    )
    from malus.bench.running.results import Results as Results, read_results as read_results
    from malus.bench.running.status import Status as Status, status as status
    from malus.bench.scoring.capture_score import score_capture as score_capture
    from malus.bench.scoring.judge import Score as Score
    from malus.bench.scoring.observe import observe as observe
    from malus.bench.scoring.score import score as score
    from malus.bench.studies.registry import run_study as run_study
    from malus.bench.studies.study import Findings as Findings, Study as Study
    from malus.reconstruct import (
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
    from malus.reconstruct.photos.capture import (
        Capture as Capture,
        read_capture as read_capture,
    )
    from malus.reconstruct.photos.capture_fit import (
        CaptureFit as CaptureFit,
        fit_capture as fit_capture,
    )
    from malus.reconstruct.photos.filter import (
        FilteredPicture as FilteredPicture,
        FilterOutput as FilterOutput,
        filter_picture as filter_picture,
    )
    from malus.reconstruct.photos.knowledge import (
        Knowledge as Knowledge,
        read_knowledge as read_knowledge,
    )
    from malus.reconstruct.photos.picture import Picture as Picture
    from malus.reconstruct.photos.read_picture import read_picture as read_picture
    from malus.reconstruct.photos.sensor_stokes import demosaiced_stokes as demosaiced_stokes
    from malus.renderers import Truth as Truth, render as render
    from malus.renderers.datasets.dataset import Dataset as Dataset
    from malus.renderers.datasets.opened import open_dataset as open_dataset
    from malus.renderers.datasets.samples import Samples as Samples
    from malus.scenes import (
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

    from malus.scenes.sensor import Sensor as Sensor
    from malus.scenes.sensor_frame import SensorFrame as SensorFrame, expose as expose

    __version__: str

_NAMES = {
    "malus.reconstruct.photos.picture": "Picture",
    "malus.reconstruct.photos.capture": "Capture read_capture",
    "malus.reconstruct.photos.capture_fit": "CaptureFit fit_capture",
    "malus.reconstruct": "ChainResult Components GivenParameters Illuminant Inapplicable Method "
    "Observation RecoveredShape Separation SurfaceParameters blind "
    "estimate_direction estimate_illuminant fit_parameters get_method "
    "illuminants methods paper polarisation_ratio recover_shape run_chain "
    "run_paper separate separations specular_dolp",
    "malus.bench.datasets.export": "export",
    "malus.bench.datasets.predictions": "PredictionErrors",
    "malus.bench.datasets.render": "render_dataset",
    "malus.bench.datasets.published_sets": "score_published",
    "malus.bench.datasets.score": "score_dataset",
    "malus.bench.learning.options": "TrainingOptions",
    "malus.bench.public.captures": "run_captures",
    "malus.bench.public.doctor": "doctor self_check",
    "malus.bench.public.gates": "BaselineUpdate GateResult gate update_baseline",
    "malus.bench.public.lists": "list_lights list_maps list_materials list_metals list_methods"
    " list_metrics list_patterns list_sensors list_shapes list_studies list_suites list_surfaces"
    " list_swatches",
    "malus.bench.public.report": "report",
    "malus.bench.public.suites": "Plan plan run",
    "malus.bench.public.tables": "compare table",
    "malus.bench.public.train": "ablate train",
    "malus.bench.running.capture_suite": "CaptureEntry CaptureSuite load_captures",
    "malus.bench.running.results": "Results read_results",
    "malus.bench.running.status": "Status status",
    "malus.bench.scoring.capture_score": "score_capture",
    "malus.bench.scoring.judge": "Score",
    "malus.bench.scoring.observe": "observe",
    "malus.bench.scoring.score": "score",
    "malus.bench.studies.registry": "run_study",
    "malus.bench.studies.study": "Findings Study",
    "malus.reconstruct.photos.filter": "FilterOutput FilteredPicture filter_picture",
    "malus.reconstruct.photos.knowledge": "Knowledge read_knowledge",
    "malus.reconstruct.photos.read_picture": "read_picture",
    "malus.reconstruct.photos.sensor_stokes": "demosaiced_stokes",
    "malus.renderers": "Truth render",
    "malus.renderers.datasets.dataset": "Dataset",
    "malus.renderers.datasets.opened": "open_dataset",
    "malus.renderers.datasets.samples": "Samples",
    "malus.scenes": "Area Blob Camera Checker Conductor Crease Dielectric Distant Environment"
    " ImageTexture InputError Interior Lathe Light Measured MeshFile Noise Patterned Placed Plane"
    " Polariser Sampling Scene Shape Sky SkyPolarisation Sphere Spots Stripes Suite Superquadric"
    " Surroundings Torus Uniform Views load_suite suite_names",
    "malus.scenes.sensor": "Sensor",
    "malus.scenes.sensor_frame": "SensorFrame expose",
}
"""Public names by the module that each comes from; `TYPE_CHECKING` above has the same ones."""

_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted(_MODULES)


if not TYPE_CHECKING:  # for a type checker every name would exist

    def __getattr__(name: str) -> Any:
        """A public name, imported from its module when it is first used."""
        if name == "__version__":
            from importlib.metadata import version

            return version("malus")
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(_MODULES[name]), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Public names, those not imported yet among them."""
    return sorted({*globals(), *_MODULES, "__version__"})
