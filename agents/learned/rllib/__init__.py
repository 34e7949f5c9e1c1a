"""Training with RLlib on the nodes of a Ray cluster; only the files of this folder load Ray."""
