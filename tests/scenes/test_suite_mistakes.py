"""A mistake in a suite is one line that says where, what was expected and what was found."""

from __future__ import annotations

from pathlib import Path

import pytest
from suite_texts import BRUSHED, GOOD

from malus.renderers import render
from malus.scenes import InputError, load_suite


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"water"', '"watre"', "watre"),
        ('"carbon"', '"coal"', "coal"),
        ("[500, 600]", "[600, 500]", "wavelengths in increasing order"),
        ("[500, 600]", "[500, 500.0000001]", "wavelengths at least 1e-5 nm apart"),
        ("[500, 600]", "[]", "wavelengths_nm"),
        ("[500, 600]", "[nan]", "nan"),
        ('materials = ["water"]', "materials = [{ eta = 0 }]", "greater than 1"),
        ('materials = ["water"]', "materials = [{ eta = -1.5 }]", "-1.5"),
        ('surfaces = ["carbon"]', "surfaces = [{ alpha = 0 }]", "greater than 0"),
        ('surfaces = ["carbon"]', "surfaces = [{ alpha = -0.1 }]", "-0.1"),
        ('kind = "sphere"', 'kind = "cube"', "cube"),
        ('kind = "sphere"', 'kind = "torus", minor = 0.8', "minor radius below"),
        ('kind = "uniform"', 'kind = "distant"', "incidence_deg"),
        ('name = "mine"', 'name = "mine"\ntypo = 1', "typo"),
        ('name = "mine"', 'name = "mine"\nmaps = [{}]', "maps.0"),
        ("methods = [", "methods = [[", "TOML"),
        ('"eq8"', '"os:system"', "name it as a method of the run"),
        ('name = "mine"', "", "name"),
    ],
)
def test_a_mistake_is_one_line_that_names_file_and_key(
    suite_file: Path, old: str, new: str, expected: str
) -> None:
    assert old in GOOD
    suite_file.write_text(GOOD.replace(old, new), "utf-8")
    with pytest.raises(InputError) as mistake:
        load_suite(suite_file)
    message = str(mistake.value)
    assert expected in message
    assert str(suite_file) in message
    assert "expected" in message
    assert "found" in message
    assert "\n" not in message


PATTERN = '{ pattern = { kind = "checker" }, parts = ["rust", "carbon"] }'
PAINT = '{ shape = { kind = "plane" }, surface = { eta = 1.5, alpha = 0.1 } }'
ALBEDO = "{{ alpha = 0.3, albedo = {} }}"
ROOM = f'surroundings = [{{ name = "room", objects = [{PAINT}] }}]'

PLAIN = "{ eta = 1.5, alpha = 0.1 }"
FAR = 'projection = "perspective", fov_deg = 160, distance = 1e4'
MISTAKES = [
    (
        '"carbon"',
        '"carbn"',
        "surfaces.0, surface",
        "the name of a surface",
        "'carbn'; did you mean carbon?",
    ),
    (
        '"water"',
        '"gould"',
        "materials.0, material",
        "the name of a material",
        "'gould'; did you mean gold?",
    ),
    (
        '"carbon"',
        ALBEDO.format('"redd"'),
        "albedo",
        "a number in 0..1 or a swatch",
        "'redd'; did you mean red?",
    ),
    (
        '"carbon"',
        ALBEDO.format("[1, 1, 1]"),
        "albedo",
        "one number a band, 2",
        "3; or give one number",
    ),
    (
        '"carbon"',
        ALBEDO.format(1.5),
        "surfaces.0.albedo",
        "less than or equal to 1",
        "1.5; correct",
    ),
    (
        '"carbon"',
        ALBEDO.format("{}"),
        "surfaces.0.albedo",
        "a number in 0..1, a swatch, or one number a band",
        "{}",
    ),
    (
        '"carbon"',
        '{ alpha = 0.2, material = "gold" }',
        "surfaces.0, key",
        "one of the keys here",
        "'material'; known: alpha, albedo, distribution",
    ),
    ('"carbon"', "3", "surfaces.0", "a name, { alpha = … } or { pattern = …, parts = […] }", "3"),
    (
        '"carbon"',
        '{ pattern = { kind = "checker" }, parts = ["carbon"] }',
        "surfaces.0.parts",
        "at least 2 item(s)",
        "['carbon']; correct this value",
    ),
    (
        '"carbon"',
        PATTERN.replace("checker", "chequer"),
        "surfaces.0.pattern.kind",
        "one of checker, stripes, spots, noise, image",
        "'chequer'; did you mean checker?",
    ),
    (
        '"carbon"',
        PATTERN.replace('"rust"', '{ alpha = "x" }'),
        "surfaces.0.parts.0.alpha",
        "a number, or two for a metal, [u, v]",
        "'x'",
    ),
    (
        '"carbon"',
        PATTERN.replace('"rust"', '{ surface = "rust", material = 2 }'),
        "parts.0.material",
        "a name, { eta = … } or { eta = …, k = … }",
        "2",
    ),
    (
        '"sphere"',
        '"spher"',
        "shapes.0.kind",
        "one of sphere, torus, blob, superquadric, lathe, mesh",
        "'spher'; did you mean sphere?",
    ),
    (
        '{ kind = "sphere" }',
        '"sphere"',
        "shapes.0",
        'a table with a kind: { kind = "…" }',
        "'sphere'",
    ),
    ('kind = "uniform"', "radiance = 1", "lights.0", 'a kind: { kind = "…" }', "{'radiance': 1}"),
    (
        'kind = "uniform"',
        'kind = "distant", incidence = 20',
        "lights.0, key",
        "one of the keys here",
        "'incidence'; did you mean incidence_deg or",
    ),
    (
        'kind = "uniform"',
        'kind = "distant"',
        "lights.0.incidence_deg",
        "this key",
        "nothing; add this key",
    ),
    ('kind = "uniform"', 'kind = "sky", sun = "yes"', "lights.0.sun", "true or false", "'yes'"),
    ('"water"', '{ eta = "1.5" }', "materials.0.eta", "a number, or one number a band", "'1.5'"),
    ("500, 600", '"500", 600', "wavelengths_nm.0", "a number", "'500'"),
    ("[500, 600]", "500", "wavelengths_nm", "a list", "500"),
    ('"water"', "", "materials", "at least 1 item(s)", "[]"),
    ("# more", "camera = { resolution = 64.5 }", "camera.resolution", "a whole number", "64.5"),
    (
        "# more",
        "camera = { half_width = 1e-30 }",
        "half_width",
        "greater than or equal to 0.001",
        "",
    ),
    (
        'kind = "uniform"',
        'kind = "uniform", radiance = 1e300',
        "radiance",
        "less than or equal to 1000000000",
        "",
    ),
    (
        '"mine"',
        '"../mine"',
        "name",
        "a name without slashes that does not begin with a dot",
        "'../",
    ),
    ("# more", 'camera = { resolution = "64" }', "camera.resolution", "a whole number", "'64'"),
    (
        "# more",
        "camera = { half_width = 1e9 }",
        "camera",
        "an object that covers a pixel",
        "a smaller one",
    ),
    ("# more", f"camera = {{ {FAR} }}", "camera", "an object that covers a pixel", "a smaller one"),
    (
        "# more",
        'bodies = ["polarized"]',
        "bodies.0",
        "'unpolarised' or 'polarised'",
        "'polarized'; did you mean polarised",
    ),
    (
        "# more",
        ROOM.replace(PLAIN, '"rust"'),
        "surroundings.0.objects.0.surface",
        'a kind: { kind = "…" }',
        "'rust'",
    ),
    (
        "# more",
        ROOM.replace("0.1 }", '0.1, albedo = "bleu" }'),
        "albedo",
        "a number in 0..1 or a swatch",
        "'bleu'; did you mean blue",
    ),
]
"""In the good suite: what stands there, what stands there instead; where, expected and found."""


@pytest.mark.parametrize(("old", "new", "where", "expected", "found"), MISTAKES)
def test_a_mistake_is_told_with_its_place_and_the_nearest_name(
    suite_file: Path, old: str, new: str, where: str, expected: str, found: str
) -> None:
    """When the suite is loaded, before anything is rendered."""
    assert old in GOOD
    suite_file.write_text(GOOD.replace(old, new, 1), "utf-8")
    with pytest.raises(InputError) as error:
        load_suite(suite_file)
    message = str(error.value)
    assert f"{where}: expected {expected}, found {found}" in message
    assert message.startswith(f"{suite_file}, ")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("finish", "more", "says"),
    [
        (PATTERN, "", "the same surface all over, found a pattern"),
        ('"rust"', ROOM, "one object, found surroundings"),
    ],
)
def test_scenes_that_the_formulas_cannot_render_are_one_line(
    suite_file: Path, finish: str, more: str, says: str
) -> None:
    text = GOOD.replace('"carbon"', finish).replace('"uniform"', '"distant", incidence_deg = 60')
    suite_file.write_text(f'{text}renderer = "torrance-sparrow"\n{more}\n', "utf-8")
    scene = next(load_suite(suite_file).scenes())
    with pytest.raises(InputError) as error:
        render(scene, renderer="torrance-sparrow")
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_bands_outside_the_table_of_a_metal_are_refused(suite_file: Path) -> None:
    # Ethylene glycol has data to 2800 nm.
    text = GOOD.replace('"water"', '"ethylene_glycol", "gold"').replace("600", "2000")
    suite_file.write_text(text, "utf-8")
    with pytest.raises(InputError, match="metal gold: expected wavelengths within its table, 292"):
        load_suite(suite_file)


def test_axes_that_multiply_to_very_many_scenes_are_refused_at_once(suite_file: Path) -> None:
    many = ", ".join(['"carbon"'] * 4000)
    text = GOOD.replace('"carbon"', many).replace('"water"', many.replace("carbon", "water"))
    suite_file.write_text(text, "utf-8")
    with pytest.raises(InputError, match="at most 10,000,000 scenes, which are 16,000,000 here"):
        load_suite(suite_file)


@pytest.mark.parametrize("content", [b"\xff\xfe", b"x" * (1 << 21)])
def test_files_that_are_no_suites(suite_file: Path, content: bytes) -> None:
    suite_file.write_bytes(content)
    with pytest.raises(InputError):
        load_suite(suite_file)


def test_unknown_suites_and_missing_meshes(suite_file: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fig5"):
        load_suite("fig6")
    with pytest.raises(InputError, match="No such file"):
        load_suite(tmp_path / "nothing.toml")
    suite_file.write_text(GOOD.replace('kind = "sphere"', 'kind = "mesh", path = "no.obj"'))
    with pytest.raises(InputError, match=r"no\.obj"):
        load_suite(suite_file)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BRUSHED.replace('"gold"', '"gold", "water"'), "expected metals only, found a dielectric"),
        (
            BRUSHED.replace('{ kind = "sphere" }', '{ kind = "torus" }'),
            "expected two alphas on one of sphere, plane, mesh, found torus",
        ),
        (BRUSHED.replace("[0.1, 0.4]", "[0.1]"), "surfaces.0.alpha"),
        (BRUSHED.replace("[0.1, 0.4]", "[0.1, 2.0]"), "surfaces.0.alpha.1"),
        (
            GOOD.replace('"carbon"', '{ alpha = 0.3, distribution = "phong" }'),
            "surfaces.0.distribution",
        ),
    ],
)
def test_facets_that_cannot_be_are_told_in_one_line(
    suite_file: Path, text: str, message: str
) -> None:
    suite_file.write_text(text, "utf-8")
    with pytest.raises(InputError) as error:
        load_suite(suite_file)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
