from ...trunk_runs.test.short_runs import hostile_run, short_run  # noqa: F401
from .page_driver import opened, reported, without_pictures  # noqa: F401
