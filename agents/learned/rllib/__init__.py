"""Training with RLlib on the nodes of a Ray cluster; Ray is loaded by the files of this folder, and by none besides."""
