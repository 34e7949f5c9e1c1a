"""How fast: ``python -m benchmarks``, one file a case.

Speeds are per CPU second of this process (`time.process_time`), the best of several blocks: on a machine that does other work
too, that is the figure that repeats.  Compare figures of one run with each other; across machines they mean little.
"""
