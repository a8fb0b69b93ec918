"""Tutorial: a photograph, which needs the extra `net`. Run it in an empty folder."""

# %% [markdown]
# # A photograph
#
# `malus filter` looks at an ordinary picture through a polarising filter. To see how far that can be believed, the picture here is
# one whose truth is known: rendered, and saved as a camera would save it.

# %%
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import malus

RESOLUTION, SAMPLES = 160, 256

scene = malus.Scene(
    shape=malus.Sphere(),
    surface=malus.Dielectric(eta=1.5, alpha=0.2, albedo="orange", body="polarised"),
    light=malus.Distant(incidence_deg=60, azimuth_deg=60),
    camera=malus.Camera(resolution=RESOLUTION),
    wavelengths_nm=(450, 550, 650),
)
truth = malus.render(scene, malus.Sampling(samples=SAMPLES))


def as_picture(light: np.ndarray) -> np.ndarray:
    """Codes of sRGB from light, red first."""
    share = np.clip(light[..., ::-1] / np.percentile(truth.image, 99.9), 0, 1)
    curve = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    return np.round(255 * curve).astype(np.uint8)


Image.fromarray(as_picture(truth.image)).save("ball.png")
Image.fromarray(255 * truth.mask.astype(np.uint8)).save("ball_mask.png")

# %% [markdown]
# There are two ways. The method `net` looks at the picture alone: a network that learned on random scenes
# ([the learned baseline](../guides/learned.md)). On a command line: `malus filter ball.png --angle 60`.

# %%
angles = malus.FilterOutput(angles_deg=(60, 150))
alone = malus.filter_picture("ball.png", out="alone", output=angles)

# %% [markdown]
# The method `blind` needs a mask, and finds the rest in the picture: the lobes by colour, the shape and the lamp by shading, and the
# roughness by the glare. The refractive index it takes for 1.5, unless it is told: without the lamp's irradiance no picture tells
# it. On a command line: `malus filter ball.png --mask ball_mask.png --angle 60`.

# %%
filtered = malus.filter_picture(
    "ball.png",
    out="filtered",
    knowledge=malus.Knowledge(mask=truth.mask),
    output=angles,
)
for line in (*filtered.statements, *filtered.warnings):
    print("-", line)

# %% [markdown]
# It says what it assumed and found. Both beside the truth, through the filter:

# %%
figure, axes = plt.subplots(3, 3, figsize=(7, 7.2), layout="constrained")
pictures = [as_picture(truth.image)] + [as_picture(2 * truth.polarised(a)) for a in (60, 150)]
for column, title in enumerate(("the photograph", "truth, filter at 60°", "truth, filter at 150°")):
    axes[0, column].imshow(pictures[column])
    axes[0, column].set_title(title, fontsize=9)
ways = (("net: the picture alone", alone), ("blind: with a mask", filtered))
for row, (name, way) in enumerate(ways, start=1):
    scale = truth.image.max() / way.components.image.max()
    for column, angle in enumerate((60, 150), start=1):
        light = 2 * scale * way.components.polarised(angle)[..., ::-1]
        axes[row, column].imshow(as_picture(light))
        axes[row, column].set_title(name, fontsize=9)
for ax in axes.flat:
    ax.set_axis_off()
figure.savefig("a_photograph.png", dpi=90)

# %% [markdown]
# ![The photograph, the truth through a filter, and the photograph filtered by `net` and by `blind`](a_photograph.png)
#
# This ball is what `blind` is made for: one object, one lamp far away, a plastic. Real rooms are not so, and there it is no
# better than a guess; `ball_uncertainty.png` in the folder `alone` says where `net` is unsure. Read [the limits](../start/limits.md) and [what each stage gets right](../single_image.md) before
# you believe a picture. To find out on pictures of your own, take them through a real filter:
# [real captures and cameras](../guides/captures.md).
