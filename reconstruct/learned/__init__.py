"""The learned method: a small network, trained on malus' own scenes, that sees a whole picture."""
