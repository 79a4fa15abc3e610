"""The same domains, processes and listener as for the other tests of the graph."""

from ..graph.conftest import children, domain, domains, peer

__all__ = ["children", "domain", "domains", "peer"]
