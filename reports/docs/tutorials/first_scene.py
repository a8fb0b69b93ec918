"""first_scene."""
# %% [markdown]
# # first_scene
