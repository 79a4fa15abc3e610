"""The conformance kit: of laws, and of anybody's node."""

from .law import CHECKS, LawCheck, LawFinding, conformance, findings_of

__all__ = ["CHECKS", "LawCheck", "LawFinding", "conformance", "findings_of"]
