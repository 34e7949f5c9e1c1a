"""What everything stands on: arrays, kernels, files, executors, and how commands talk."""
