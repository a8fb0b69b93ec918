"""The interactive viewer of the page and the images that it shows."""
