"""``python -m crowd_env`` is the command ``crowd-env``."""

from crowd_env.cli.main import main

if __name__ == "__main__":
    main()
