"""a_data_set."""
# %% [markdown]
# # a_data_set
