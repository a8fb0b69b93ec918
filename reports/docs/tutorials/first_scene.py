"""Tutorial: a first scene. Run it anywhere; it writes first_scene.png and first_scene_scores.png."""

# %% [markdown]
# # A first scene
#
# A plastic ball under a lamp: what is polarised on it, and how well do three methods tell that from one ordinary picture?

# %%
import matplotlib.pyplot as plt
import numpy as np

import malus

RESOLUTION, SAMPLES = 128, 128

scene = malus.Scene(
    shape=malus.Sphere(),
    surface=malus.Dielectric(material="pmma", alpha=0.3, albedo=0.3, body="polarised"),
    light=malus.Distant(incidence_deg=60, azimuth_deg=60),
    camera=malus.Camera(resolution=RESOLUTION),
    wavelengths_nm=(550,),
)
truth = malus.render(scene, malus.Sampling(samples=SAMPLES))

# %% [markdown]
# `truth.stokes` holds three numbers a pixel and band, from which the picture through a polariser follows at any angle, and how
# much of the light is polarised: the degree of linear polarisation, DoLP. The angle counts from the vertical, anticlockwise.

# %%
pictures = {
    "ordinary picture": truth.image[:, :, 0],
    "polariser at 60°": 2 * truth.polarised(60)[:, :, 0],
    "polariser at 150°": 2 * truth.polarised(150)[:, :, 0],
    "DoLP, 0 to 1": truth.dolp[:, :, 0] * truth.image.max(),
}
figure, axes = plt.subplots(1, 4, figsize=(9, 2.5), layout="constrained")
for ax, (title, picture) in zip(axes, pictures.items(), strict=True):
    ax.imshow(picture, cmap="gray", vmin=0, vmax=truth.image.max())
    ax.set_title(title, fontsize=9)
    ax.set_axis_off()
figure.savefig("first_scene.png", dpi=90)

# %% [markdown]
# ![The ball, through a polariser at two angles, and its degree of polarisation](first_scene.png)
#
# Light from the lamp makes the upper right of the ball shine. One polariser passes more than twice
# as much of that glare as the other.
#
# Now the methods. Each is told the unpolarised image, the mask and what it asks for, and returns a picture for every angle of
# the polariser. *Skill* is 1 for a perfect one and 0 for the guess that nothing is polarised.

# %%
skills = {
    name: malus.score(truth, name).skill for name in ("eq8", "half_vector", "half_vector+body")
}
for name, skill in skills.items():
    print(f"{name:18} skill {skill:6.2f}")

# %% [markdown]
# The paper's model, `eq8`, takes light to come from everywhere, and is worse than the guess here. `half_vector` knows where the
# lamp is, but not that the light of the body is polarised too. `half_vector+body` knows both, and is right.
#
# A method's own picture, beside the truth:

# %%
method = malus.get_method("half_vector+body")
estimate = method.reconstruct(malus.observe(truth, method.needs))
error = np.abs(estimate.polarised(60) - truth.polarised(60))[:, :, 0]
print(f"largest error at 60°: {error.max() / truth.image.max():.1%} of the brightest pixel")

figure, ax = plt.subplots(figsize=(5, 2), layout="constrained")
ax.barh(list(skills), list(skills.values()), color=["tab:red", "tab:orange", "tab:green"])
ax.axvline(0, color="black", lw=0.8)
ax.set_xlabel("skill")
figure.savefig("first_scene_scores.png", dpi=90)

# %% [markdown]
# ![Skill of three methods](first_scene_scores.png)
#
# Next: [a method in ten lines](a_method.md).
