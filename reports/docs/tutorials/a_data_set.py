"""Tutorial: a data set and a loader. Run it in an empty folder; it writes a_data_set.png."""

# %% [markdown]
# # A data set and a loader
#
# Draw scenes at random, render them, and train on them. A *suite* says what to draw from; here balls and blobs of any plastic
# under a lamp. `disjoint` keeps the materials of the test apart from those of the training.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import malus
from malus.scenes.polarisation import dolp

COUNT, RESOLUTION, SAMPLES = 24, 64, 32

Path("drawn.toml").write_text(f"""
name = "drawn"
wavelengths_nm = [550]
methods = ["unpolarised"]
camera = {{ resolution = {RESOLUTION} }}
sampling = {{ samples = {SAMPLES}, seed = 1 }}

[random]
count = {COUNT}
seed = 1
shapes = [{{ kind = "sphere" }}, {{ kind = "blob", seed = {{ integers = [0, 999] }} }}]
materials = [{{ eta = {{ uniform = [1.3, 1.7] }} }}]
surfaces = [{{ alpha = {{ log_uniform = [0.1, 0.5] }}, albedo = {{ uniform = [0.3, 0.8] }} }}]
bodies = ["polarised"]
lights = [{{ kind = "distant", incidence_deg = {{ uniform = [10, 60] }} }}]

[splits]
train = 0.75
test = 0.25
disjoint = ["material"]
""")
malus.render_dataset("drawn.toml", "drawn")

# %% [markdown]
# The folder has a card, `README.md`, and stops and goes on like every long job. `malus.open_dataset` gives samples of named
# arrays, by index, with crops; it is what a `torch.utils.data.DataLoader` asks for.

# %%
train = malus.open_dataset("drawn", split="train", maps=("image", "stokes", "normals", "mask"))
print(len(train), {name: array.shape for name, array in train[0].items() if name != "scene"})

figure, axes = plt.subplots(2, 6, figsize=(9, 3.2), layout="constrained")
for column in range(6):
    sample = train[column % len(train)]
    degree = dolp(sample["stokes"][:, :, 0])
    axes[0, column].imshow(sample["image"][:, :, 0], cmap="gray")
    axes[1, column].imshow(degree, cmap="viridis", vmin=0, vmax=0.5)
for ax in axes.flat:
    ax.set_axis_off()
figure.savefig("a_data_set.png", dpi=80)

# %% [markdown]
# ![Six pictures of the training split, and their degree of polarisation](a_data_set.png)
#
# In place of a network, the smallest thing that learns: how strongly is light polarised along the normal, by the square of the
# sine of the zenith angle? One number, by least squares.


# %%
def along_the_normal(sample: dict[str, np.ndarray]) -> np.ndarray:
    """What s1 and s2 are where light oscillates in the plane of normal and viewer, times s0."""
    x, y = sample["normals"][..., 0], sample["normals"][..., 1]
    return np.stack([x**2 - y**2, 2 * x * y], -1) * sample["image"][:, :, :1]


features, targets = [], []
for sample in train:
    inside = sample["mask"]
    features.append(along_the_normal(sample)[inside])
    targets.append(sample["stokes"][:, :, 0, 1:][inside])
x, y = np.concatenate(features).ravel(), np.concatenate(targets).ravel()
weight = float(x @ y / (x @ x))
print(f"learned weight {weight:.3f}")

# %% [markdown]
# Predictions are files, one a scene; `malus.score_dataset` scores them beside any method, here on the test split alone.

# %%
Path("predictions").mkdir(exist_ok=True)
for sample in malus.open_dataset(
    "drawn", split="test", maps=("image", "stokes", "normals", "mask")
):
    stokes = np.zeros((*sample["image"].shape, 3), np.float32)
    stokes[..., 0] = sample["image"]
    stokes[:, :, 0, 1:] = weight * along_the_normal(sample)
    np.savez(f"predictions/{sample['scene']}.npz", stokes=stokes)
results = malus.score_dataset("drawn", ["eq8+body"], "predictions", "learned", split="test")

table = results.table
chosen = table[(table.metric == "skill") & table.band_nm.isna() & table.angle_deg.isna()]
print(chosen.groupby("method", observed=True).value.median().round(2).to_string())

# %% [markdown]
# On most scenes light from the body decides, which oscillates along the normal: one number is better than the guess. What a
# network makes of the picture alone is in [the learned baseline](../guides/learned.md); shards, parts and a cluster are in
# [data sets to train on](../guides/data_sets.md).
