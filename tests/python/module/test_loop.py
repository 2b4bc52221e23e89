import json

import numpy as np
import pytest
from conftest import sheet

import eplat


@pytest.fixture(scope="module")
def closed(tmp_path_factory):
    """Brackets on a sheet with an undeclared effect of contact force, -12 ms per g."""
    pandas = pytest.importorskip("pandas")
    rng = np.random.default_rng(3)
    mesh = sheet()
    x, y = mesh[0][:, 0] / 5, mesh[0][:, 1] / 5
    force, wall, noise = rng.standard_normal((3, len(x)))
    value = 90 + 10 * np.sin(0.5 * x) + 8 * np.cos(0.4 * y) - 12 * force + 2 * noise
    lower = 10 * np.floor(value / 10)
    site = np.arange(len(x))
    table = pandas.DataFrame(
        dict(site=site, vertex=site, protocol="S1S2", lower=lower, upper=lower + 10, force_g=force, wall_mm=wall)
    )
    heldout = table[table.site % 3 == 2]
    train = table[table.site % 3 != 2]
    told = []
    out = tmp_path_factory.mktemp("loop") / "out"
    result = eplat.loop("recovery", mesh, train, heldout, out, units="mm", nulls=19, progress=told.append)
    return result, told


def test_what_is_missing_is_found_and_added(closed):
    result, told = closed
    assert result.finding["findings"] == ["force_g"]
    assert result.finding == json.loads((result.path / "finding.json").read_text())
    assert "force_g" in result.model and "model!" in result.model
    error = result.finding["heldout"]
    assert error["rmse_after"] < error["rmse_before"]
    assert result.after is not None and any("force_g" in name for name in result.after.summary().index)
    assert not any("force_g" in name for name in result.declared.summary().index)
    assert result.before is None or result.before.path.name == "before"
    assert repr(result).startswith("<eplat.LoopResult: found force_g, in ")


def test_its_progress_is_that_of_searches_and_fits(closed):
    _, told = closed
    searches = [event for event in told if event["event"] == "search"]
    assert {event["of"] for event in searches} == {19} and searches[-1]["done"] == 19
    assert [event["which"] for event in told if event["event"] == "sample"][0] == "declared"


def test_a_table_without_measurements_is_refused():
    with pytest.raises(eplat.UsageError, match="eplat loop criticises a model on measurements"):
        eplat.loop("recovery", "embedded")
