from ...trunk_runs.test.short_runs import hostile_run, short_run  # noqa: F401
