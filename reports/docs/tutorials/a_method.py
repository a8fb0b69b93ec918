"""a_method."""
# %% [markdown]
# # a_method
