"""The paper's verdicts agree with their numbers, every erratum is shown, the report is complete."""

import json
import re
from dataclasses import fields
from math import degrees, inf, nan
from urllib.parse import quote

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trunk_core.results import values as json_values
from trunk_evidence.run_metrics import Metrics
from trunk_evidence.run_table import RunTable
from trunk_studies.paper import reproduction as paper_report
from trunk_studies.paper.claims import (
    CLAIMS,
    NOT,
    PARTLY,
    PROFILES,
    REPRODUCED,
    PaperRun,
    cases,
    judge,
    undershoot,
)
from trunk_studies.paper.errata import ERRATA, plain, single_repairs
from trunk_studies.paper.reproduction import Reproduction, formulas, paper_numbers

NAMES = [f.name for f in fields(Metrics)]


def invented(seed):
    """Return a run of random metrics for every case; some never settle, some diverge."""
    rng = np.random.default_rng(seed)
    runs = {}
    for case in cases():
        values = dict(
            zip(NAMES, rng.exponential(10.0 ** rng.uniform(-2, 2), len(NAMES)), strict=True)
        )
        if rng.random() < 0.3:
            values["settling_time_6deg_s"] = None
        diverged = rng.random() < 0.1
        runs[case] = PaperRun(
            case,
            None if diverged else Metrics(**values),
            inf if diverged else float(rng.exponential()),
            "diverged" if diverged else "",
        )
    return runs


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_a_verdicts_text_agrees_with_its_numbers(seed):
    result = Reproduction(runs=invented(seed), graph=invented(seed))
    text = json.dumps(json_values(paper_numbers(result)), allow_nan=False)  # as a reader gets it
    for claim in json.loads(text)["claims"]:
        for kind in ("offline", "graph", "practical"):
            verdict = claim[kind]
            held = []
            for check in verdict["checks"]:
                value = inf if check["value"] is None else check["value"]
                bound = inf if check["bound"] is None else check["bound"]
                assert check["holds"] == (
                    value <= bound if check["relation"] == "<=" else value > bound
                )
                held.append(check["holds"])
            word = REPRODUCED if all(held) else PARTLY if any(held) else NOT
            assert verdict["verdict"] == word
            assert verdict["text"].startswith(word)
            if word == PARTLY:
                holds, fails = verdict["text"].split("; not for ")
                for check in verdict["checks"]:
                    assert check["label"] in (holds if check["holds"] else fails)
        assert claim["offline"] == claim["graph"]


def test_a_claim_flips_with_its_deciding_number():
    runs = invented(1)
    steady = next(claim for claim in CLAIMS if claim.key == "fuzzy-steady")
    names = ("fuzzy_as_printed", "fuzzy_zhao_1993")
    for rms, word in ((0.1, REPRODUCED), (9.0, NOT)):
        values = {**dict.fromkeys(NAMES, 1.0), "steady_state_error_rms_deg": rms}
        for case in runs:
            if case.contender in names:
                runs[case] = PaperRun(case, Metrics(**values), 0.0)
        assert judge(steady, runs, PROFILES[0]).word == word


def test_claims_are_distinct():
    assert len({claim.key for claim in CLAIMS}) == len(CLAIMS)
    for claim in CLAIMS:
        assert claim.quote
        assert claim.tolerance


@pytest.mark.slow
@pytest.mark.parametrize("erratum", ERRATA, ids=lambda e: e.where)
def test_every_erratum_is_shown(erratum):
    shown, text = erratum.show()
    assert shown, text


def test_single_repairs_of_a_table():
    table = ("B S B S B S B",) * 7
    assert single_repairs(table) == [(3, 3)]  # the middle cell is its own mirror image
    broken = ("B S B S B S S", *table[1:])
    assert single_repairs(broken) == [(0, 6)]


def swing(angles):
    t = np.linspace(0.0, 1.0, len(angles))
    unused = dict.fromkeys(RunTable.__dataclass_fields__, np.full(t.shape, nan))
    theta = np.asarray(angles, dtype=float)
    return RunTable(**{**unused, "t": t, "theta": theta, "reference": np.zeros(len(t))})


def test_undershoot_is_the_swing_back():
    assert undershoot(swing([0.5, 0.2, -0.1, 0.3, -0.05])) == pytest.approx(degrees(0.3))
    assert undershoot(swing([-0.5, 0.1, -0.2, 0.0])) == pytest.approx(degrees(0.2))
    assert undershoot(swing([0.5, 0.2, 0.1, 0.3])) == 0.0
    assert undershoot(swing([0.5, -0.2, -0.1])) == 0.0


def test_the_verdict_in_two_sentences():
    said = paper_report.lead(Reproduction(runs=invented(2)))
    hold, partly, fail = map(int, re.findall(r"(\d+) (?:hold|fail)", said))
    assert hold + partly + fail == len(CLAIMS)
    assert re.search(r"Table 1 in \d+ of \d+ comparisons\.$", said)


def test_the_report_is_one_file_with_every_part(tmp_path, monkeypatch):
    monkeypatch.setattr(paper_report, "_figure", lambda figure, folder: "data:image/png;base64,AA")
    result = Reproduction(
        runs=invented(2),
        graph=invented(2),
        errata=[(ERRATA[0], True, "a < b")],
        rates={"fig7": {1000.0: dict.fromkeys(paper_report.RATE_KEYS, 1.0), 250.0: None}},
        literal={"none, derived": None},
    )
    page = paper_report.write_report(result, tmp_path).read_text(encoding="utf-8")
    order = (
        "of its 10 claims",
        'href="fig9.html"',
        CLAIMS[0].quote,
        "profile practical",
        "a &lt; b",
    )
    assert sorted(page.index(text) for text in order) == [page.index(text) for text in order]
    parts = [claim.see[0] for claim in CLAIMS if claim.see is not None]
    assert parts
    assert all(f'href="#{part}"' in page and f'id="{part}"' in page for part in parts)
    for text in ("<main>", "diverges", "never", *(claim.why.split("'")[0] for claim in CLAIMS)):
        assert text in page
    assert page.count("<article") == page.count('<p class="verdict">') == len(CLAIMS)
    assert 'src="http' not in page
    assert json.loads((tmp_path / "paper.json").read_text())["errata"][0]["shown"] is True


@pytest.mark.browser
def test_paper_is_filled_and_no_picture_is_white_in_the_dark(new_page, tmp_path, monkeypatch):
    svg = "<svg xmlns='http://www.w3.org/2000/svg' width='1200' height='690'/>"
    monkeypatch.setattr(
        paper_report, "_figure", lambda figure, folder: f"data:image/svg+xml,{quote(svg)}"
    )
    errata = [(erratum, True, "") for erratum in ERRATA]
    report = paper_report.write_report(Reproduction(runs=invented(2), errata=errata), tmp_path)
    page = new_page(color_scheme="dark")
    page.goto(report.as_uri())
    images = "all => all.map((one) => getComputedStyle(one).filter)"
    assert "none" not in page.eval_on_selector_all("img", images)
    assert page.pdf(format="A4").count(b"/Type /Page\n") <= 7  # one is the table of each profile


@pytest.mark.browser
def test_no_formula_is_wider_than_a_phone(new_page):
    page = new_page(viewport={"width": 390, "height": 844})
    texts = [text for one in ERRATA for text in (one.printed, one.correct)]
    page.set_content("".join(f"<p>{formulas(text)}</p>" for text in texts))
    assert page.locator("math").count() > 2 * len(ERRATA)
    assert page.evaluate("() => document.documentElement.scrollWidth") == 390


def test_errata_are_printed_as_mathematics():
    page = formulas("no $θ̇²$; a < $M⁻¹V − K_{p,max}$")
    assert page == (
        "no <math><msup><mover><mi>θ</mi><mo>˙</mo></mover><mn>2</mn></msup></math>; a &lt; "
        "<math><msup><mi>M</mi><mn>−1</mn></msup><mi>V</mi></math>"
        '<math><mo form="infix">−</mo>'
        "<msub><mi>K</mi><mtext>p,max</mtext></msub></math>"
    )
    for erratum in ERRATA:
        for text in (erratum.printed, erratum.correct):
            assert text.count("$") % 2 == 0
            assert not set("$_{}") & set(plain(text))
            outside = "".join(text.split("$")[::2])  # of the formulas
            assert not set("θẋẍė²⁻") & set(outside), text
