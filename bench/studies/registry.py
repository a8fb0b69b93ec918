"""Studies: benchmarks and tables of fixed cases, each with its options, in one registry.

`malus bench NAME` and `malus run NAME` run them alike. This module is read for the command line's
help, so nothing heavy is imported before a study runs.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from malus.bench.studies.study import Findings, Study, StudyOption, option_values


def run_study(name: str, out: Path | str | None = None, **options: Any) -> Findings:
    """Run a study: a benchmark, or a table of fixed cases.

    Parameters
    ----------
    name : str
        As `list_studies` has it.
    out : path or URL of a folder, optional
        Where tables and page, or the figures as JSON, are written. By default results/NAME for a
        study with a page, nowhere for another.
    **options
        As `list_studies()[name].options` has them.

    Returns
    -------
    Findings
        Figures, in words and for machines, and whether the study passed.

    Raises
    ------
    InputError
        An unknown study or option, a value out of its range, a folder that cannot be written or
        that holds something else.

    Examples
    --------
    >>> findings = run_study("reconstruct", megapixels=0.001, repeats=1)
    >>> findings.passed, sorted({row["method"] for row in findings.figures})[0]
    (True, 'eq8')
    """
    from malus.bench.running.output_folder import prepare_folder
    from malus.scenes.core.registry import lookup
    from malus.scenes.core.remote import as_path

    study = lookup(name, STUDIES, "study")
    values = option_values(study, options)
    if out is None and study.has_page:
        out = Path("results") / name
    folder = None
    if out is not None:
        folder = prepare_folder(as_path(out), "a study" if study.has_page else "")
    findings = study.run(folder, **values)
    if folder is not None:
        _write(study, folder, findings)
    return findings


def _write(study: Study, folder: Path, findings: Findings) -> None:
    """run.json and the page of a study that has one; the figures as NAME.json of any other."""
    from malus.bench.running.results import origin, write_run
    from malus.reports.write import write_study
    from malus.scenes.core.files import replace_text
    from malus.scenes.core.json_text import json_text

    if study.has_page:
        write_run(folder, origin() | {"study": study.name, "description": study.description})
        write_study(folder)
        return
    text = json_text(findings.figures, 2, sort_keys=True) + "\n"
    replace_text(folder / f"{study.name}.json", text)


def _from(module: str) -> Callable[..., Findings]:
    """The `findings` of a module of this folder, imported when the study runs."""

    def run(folder: Path | None, **options: Any) -> Findings:
        from importlib import import_module

        found: Findings = import_module(f"malus.bench.studies.{module}").findings(folder, **options)
        return found

    return run


_BACKEND = StudyOption("backend", "auto", "auto, cuda, llvm or scalar.")

STUDIES = {
    study.name: study
    for study in (
        Study(
            "stress",
            "Stiff and extreme cases, each with its error and a verdict",
            _from("stress"),
            has_page=True,
        ),
        Study(
            "precision",
            "Error against run time: R, rendering, whole methods",
            _from("precision"),
            options=(_BACKEND,),
            has_page=True,
        ),
        Study(
            "paper",
            "The paper's Figure 5 for every meaning of “normalised”: eq8, whole chain, and guess",
            _from("paper_readings"),
            details="24 materials on 5 surfaces, 5 lights, 4 albedos, 10 readings; the paper's"
            " height and flatness beside each.",
            example={"every": "2"},
            options=(
                StudyOption("every", 1, "Every n-th material.", least=1, most=24),
                StudyOption("resolution", 32, "Pixels a side.", least=8, most=512),
                _BACKEND,
            ),
            has_page=True,
        ),
        Study(
            "mismatch",
            "What each assumption costs: skill where truth or input is not as methods assume",
            _from("mismatch"),
            details="Facets, bounces, polarised light, mixed pixels, several objects, masking;"
            " wrong index, roughness, light and normals; the rungs of the ladder.",
            example={"resolution": "24", "samples": "32"},
            options=(
                StudyOption("resolution", 48, "Pixels a side.", least=16, most=512),
                StudyOption("samples", 256, "Samples a pixel.", least=2),
                _BACKEND,
            ),
            has_page=True,
        ),
        Study(
            "separation",
            "Separations of the lobes by colour: error of I_s on the exact lobes of renders",
            _from("separation"),
            details="Two shapes, two bodies, five surfaces, four lights, seven body colours.",
            example={"every": "12"},
            options=(
                StudyOption("every", 24, "Every n-th material.", least=1, most=24),
                StudyOption("resolution", 48, "Pixels a side.", least=8, most=512),
                _BACKEND,
            ),
            has_page=True,
        ),
        Study(
            "ratio",
            "Tables of one surface, and R of scattered points, beside dblquad a point",
            _from("speed_ratio"),
            example={"points": "100000"},
            options=(StudyOption("points", 1_000_000, "Points of R.", least=1, most=10**8),),
        ),
        Study(
            "reconstruct",
            "Whole RGB images, beside copying the same bytes",
            _from("speed_reconstruct"),
            example={"megapixels": "2"},
            options=(
                StudyOption("megapixels", 10.0, "Size of the images.", least=1e-5, most=1000),
                StudyOption("repeats", 5, "Runs, of which the median counts.", least=1),
            ),
        ),
        Study(
            "render",
            "Polariser images of 24 materials, 5 surfaces and 8 bands, beside two ways by hand",
            _from("speed_render"),
            example={"resolution": "64"},
            options=(
                StudyOption("resolution", 128, "Pixels a side.", least=2),
                StudyOption("samples", 64, "Samples a pixel.", least=2),
                _BACKEND,
            ),
        ),
        Study(
            "cores",
            "A reduced fig5 on one core, two, … and all: speed-up, and what bounds it",
            _from("cores"),
            details="Each number of cores has a process of its own; start, compilation and report"
            " do not count.",
            example={"every": "4"},
            options=(
                StudyOption("most", 0, "Most cores; 0 for all that may be used.", least=0),
                StudyOption("resolution", 96, "Pixels a side.", least=2),
                StudyOption("samples", 128, "Samples a pixel.", least=2),
                StudyOption("every", 1, "Every n-th material.", least=1, most=24),
                _BACKEND,
            ),
        ),
        Study(
            "loader",
            "Reading a dataset for training, from folders, shards and HDF5, beside plain EXR",
            _from("speed_loader"),
            example={"epochs": "4"},
            options=(
                StudyOption("resolution", 96, "Pixels a side.", least=2),
                StudyOption("epochs", 20, "How often every scene is read.", least=1),
                _BACKEND,
            ),
        ),
        Study(
            "scaling",
            "What many scenes cost besides rendering: planning, tables, files, memory, scheduler",
            _from("scaling"),
            details="Scenes up to the most asked for are measured with made-up results, in steps of"
            " ten; 1e5 and 1e6 are drawn on from there.",
            example={"most": "1000"},
            options=(
                StudyOption("most", 10_000, "Scenes of the largest run.", least=48, most=10**6),
            ),
        ),
        Study(
            "single-image",
            "What one ordinary image tells, stage by stage, on 24 materials, 5 surfaces, 2 bodies",
            _from("single_image"),
            details="Stages: separation of the lobes, the whole chain, or speed.",
            example={"stage": "separation", "every": "24"},
            options=(
                StudyOption(
                    "stage",
                    None,
                    "What is measured.",
                    choices=("separation", "chain", "speed"),
                    required=True,
                ),
                StudyOption("shapes", ("sphere", "blob"), "Shapes.", flag="shape"),
                StudyOption("every", 1, "Every n-th material.", least=1, most=24),
                StudyOption("levels", ("blind-light",), "What the chain is told.", flag="level"),
                StudyOption("resolution", 48, "Pixels a side."),
                StudyOption("coloured", False, "Coloured bodies for the chain too."),
                StudyOption(
                    "rows",
                    None,
                    "Write every row as a line of JSON; scenes that the file has from this version"
                    " of malus are not measured again.",
                    is_file=True,
                ),
            ),
        ),
    )
}
"""Every study by name."""
