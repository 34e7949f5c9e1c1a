"""``python -m validation [CASE ...]``."""

from validation.cli import main

if __name__ == "__main__":
    main()
