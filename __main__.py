"""`python -m malus`: the command line."""

from malus.bench.cli import main

if __name__ == "__main__":  # not where a worker process reads it again
    main()
