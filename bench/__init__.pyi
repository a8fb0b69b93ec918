from .running.results import Results as Results, read_results as read_results
from .running.runner import run as run
from .scoring.observe import observe as observe
from .scoring.score import score as score
