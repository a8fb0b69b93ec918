"""Tutorial: a method in ten lines. Run it anywhere; it writes a_method.png."""

# %% [markdown]
# # A method in ten lines
#
# A method is a name, what it must be told besides the picture, and one function. This one believes that polarisation grows
# towards the rim of things, and that it lies along the normal:

# %%
import matplotlib.pyplot as plt
import numpy as np

import malus

RESOLUTION, SAMPLES = 64, 64


def towards_the_rim(observation: malus.Observation) -> malus.Components:
    """Polarise the specular light by the square of the sine of the zenith angle."""
    x, y = observation.normals[..., 0, None], observation.normals[..., 1, None]
    polarised = 0.8 * (x**2 + y**2) * observation.specular  # I_max - I_min, one per band
    image = observation.image
    i_max, i_min = 0.5 * (image + polarised), 0.5 * (image - polarised)
    return malus.Components.from_extremes(i_max, i_min, phase=np.arctan2(y, x))


mine = malus.Method("mine", frozenset({"specular", "normals"}), towards_the_rim, "grows to the rim")

# %% [markdown]
# What it does not name is `None`: a method cannot look at the truth by accident. Score it beside the paper's model on
# some scenes of a suite, rendered small, so that a try takes seconds:

# %%
suite = malus.load_suite("quick")
skills: dict[str, list[float]] = {"mine": [], "eq8": []}
labels = []
for scene in list(suite.scenes())[::3]:
    small = scene.model_copy(update={"camera": malus.Camera(resolution=RESOLUTION)})
    truth = malus.render(small, malus.Sampling(samples=SAMPLES))
    labels.append(f"{scene.surface.label}, {scene.surface.body}, {scene.light.label}")
    for name, method in (("mine", mine), ("eq8", "eq8")):
        skills[name].append(malus.score(truth, method).skill)
for label, own, paper in zip(labels, skills["mine"], skills["eq8"], strict=True):
    print(f"{label:40} mine {own:7.2f}   eq8 {paper:7.2f}")

# %% [markdown]
# In the last scene both are worse than the guess. Its truth, and what both say of it, tell why: the light of the body is
# polarised at the rim, and neither knows of it.

# %%
observed = malus.observe(truth, mine.needs | malus.get_method("eq8").needs)
fields = {
    "truth": truth.stokes[:, :, 0],
    "mine": mine.reconstruct(observed).stokes[:, :, 0],
    "eq8": malus.get_method("eq8").reconstruct(observed).stokes[:, :, 0],
}
figure, axes = plt.subplots(1, 3, figsize=(7, 2.6), layout="constrained")
top = np.hypot(*np.moveaxis(fields["truth"][..., 1:], -1, 0)).max()
for ax, (title, stokes) in zip(axes, fields.items(), strict=True):
    ax.imshow(np.hypot(stokes[..., 1], stokes[..., 2]), cmap="magma", vmin=0, vmax=top)
    ax.set_title(f"polarised light: {title}", fontsize=9)
    ax.set_axis_off()
figure.savefig("a_method.png", dpi=90)

# %% [markdown]
# ![Polarised light: truth, my method, the paper's](a_method.png)
#
# In a file of its own a method has a name on the command line, `--method my_method:mine`, in every suite, gate and capture:
# [your own method](../guides/methods.md).
