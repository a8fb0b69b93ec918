from .datasets.dataset import Dataset as Dataset
from .datasets.opened import open_dataset as open_dataset
from .rendering import render as render
from .truth import Truth as Truth
