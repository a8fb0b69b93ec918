"""One method on one truth: errors, skill, colour and what knowledge is worth."""
