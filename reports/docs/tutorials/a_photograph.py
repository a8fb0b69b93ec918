"""a_photograph."""
# %% [markdown]
# # a_photograph
