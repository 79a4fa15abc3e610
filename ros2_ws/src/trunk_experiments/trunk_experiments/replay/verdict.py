"""What `verify` found: checks and their results, what does not fit, what was not judged."""

from __future__ import annotations

from dataclasses import dataclass, field

from .checks import Check, describe

__all__ = ["DIVERGES", "UNJUDGED", "VERIFIED", "Check", "SignatureCheck", "Verdict"]

VERIFIED, DIVERGES, UNJUDGED = 0, 1, 2
NOT_SIGNED = "not signed"  # the verdict's word if nothing else is wrong
_ORIGIN = "the origin (scenario, commit, host, time): covered by"
ORIGIN = f"{_ORIGIN} digests alone"
ORIGIN_SIGNED = f"{_ORIGIN} digests and the signature; the signer vouches for it"


@dataclass(frozen=True)
class SignatureCheck:
    """Whether a signature is of this content, and by the key that was asked for.

    ``trusted``: the name of that key's file; None: any key will do. ``fingerprint``: of the trusted key,
    or else of the signature's; empty if neither is known. ``fault``: why it does not count; empty: it does.
    """

    file: str
    trusted: str | None
    fingerprint: str
    fault: str = ""
    other_content: bool = False  # a whole signature, by the right key, but of something else

    @property
    def refuted(self) -> bool:
        """True if the signature is of other content, or does not count although a key was given."""
        return bool(self.fault) and (self.other_content or self.trusted is not None)

    def describe(self) -> str:
        """Return the finding as one line."""
        if self.trusted is not None:
            who = f"{self.fingerprint} ({self.trusted})"
            return f"not signed by {who}: {self.fault}" if self.fault else f"signed by {who}"
        if self.fault:
            return f"signature: {self.fault}"
        return f"signed by key {self.fingerprint} ({self.file}); --key PUBLIC checks whose it is"


@dataclass
class Verdict:
    """What `verify` found.

    ``altered``: what is not as the recorder wrote it, by its digests, even if no computed bit depends on it.
    ``contradictions``: where two parts of the recording do not agree.
    ``obstacles``: why the run cannot be judged as a whole. ``unjudged``: what no check looks at.
    """

    checks: list[Check] = field(default_factory=list)
    altered: list[str] = field(default_factory=list)
    contradictions: list[str] = field(default_factory=list)
    obstacles: list[str] = field(default_factory=list)
    unjudged: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    judged: str = ""  # the run in a few words
    signature: SignatureCheck | None = None  # None: not asked for, and there is none

    @property
    def exit_code(self) -> int:
        """0: verified, 1: it diverges or is not signed as asked, 2: inconclusive."""
        if self.diverges or (self.signature and self.signature.refuted):
            return DIVERGES
        return UNJUDGED if self.obstacles or not self._judged else VERIFIED

    @property
    def _judged(self) -> bool:
        return bool(self.checks) and all(check.steps for check in self.checks)

    @property
    def diverges(self) -> bool:
        """True if something differs from what was computed, recorded elsewhere, or signed."""
        differs = self.altered or self.contradictions or any(c.wrong_steps for c in self.checks)
        return bool(differs or (self.signature and self.signature.other_content))

    @property
    def word(self) -> str:
        """The verdict in a word or two."""
        if self.exit_code == DIVERGES and not self.diverges:
            return NOT_SIGNED
        return ("verified", "diverges", "inconclusive")[self.exit_code]

    @property
    def reasons(self) -> list[str]:
        """Why it is not verified, a line each; empty if it is."""
        return [
            *(f"altered: {part}" for part in self.altered),
            *self.contradictions,
            *self.obstacles,
            *(f"{check.name}: {describe(check.first[0])}" for check in self.checks if check.first),
            *([self.signature.describe()] if self.signature and self.signature.refuted else []),
        ]
