"""The domains given to tests are empty, whatever earlier tests left running."""

from __future__ import annotations

import pytest

from .conftest import Domains
from .peer import Peer

pytestmark = pytest.mark.graph


def test_a_domain_with_a_participant_left_in_it_is_not_given_out(
    domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, left = Peer("first"), Peer("left")
    first.close()
    monkeypatch.setenv("TRUNK_TEST_DOMAIN", str(domain))
    monkeypatch.setattr("tests.graph.conftest._LOCK", "another-session-{}")
    domains = Domains()
    assert domains.choose() != domain
    left.close()
    domains.close()
