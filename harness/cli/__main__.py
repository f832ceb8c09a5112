"""``python -m harness.cli``: the same as ``vfoa``."""

from harness.cli import main

if __name__ == "__main__":
    main()
