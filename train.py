"""Train a policy to lead a crowd out, and compare it with the rules: the main job, as ``make train``, ``crowd-env train``."""

from crowd_env.cli.agents.learn import app

if __name__ == "__main__":
    app()
