from .short_runs import hostile_run, short_run  # noqa: F401
