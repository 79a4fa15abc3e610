"""The conformance kit: for laws, and for any node."""

from .law import CHECKS, LawCheck, LawFinding, conformance, findings_of

__all__ = ["CHECKS", "LawCheck", "LawFinding", "conformance", "findings_of"]
