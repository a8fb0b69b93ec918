"""Functions that do what the commands do: they return values and print nothing.

Users find them as `malus.run`, `malus.plan` and so on; the commands are options, one call of
these, and printing.
"""
