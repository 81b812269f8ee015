"""What the functional envelope gives up, and a constant does: the study's numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.yamlfile import read_config
from wideberth.framework.values.errors import WideberthError
from wideberth.packages.arenas.tests.test_field_rows import course
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth_arenas.controllers.functional_envelope import FieldGrid, distance_field
from wideberth_arenas.studies.conformal_protocol import RecordedCourse
from wideberth_arenas.studies.field_price import METHODS, FieldPrice, Fields
from wideberth_arenas.studies.field_rows import FieldRows

CONFIG = Path(__file__).parents[1] / "configs" / "field_price.yaml"
STEADY = ConstantVelocity(window=1)


def test_errors_are_the_fields_suprema_over_a_dense_grid():
    """sup_x (D_pred - D) = max_j min_k |t_j - p_k|: a fine grid comes near to it from below."""
    rows = FieldRows.of(course(), STEADY, 4)
    some = rows.chosen(np.isin(rows.rows, rows.rows[40:90:10]))
    everywhere = some.actual[np.isfinite(some.actual[..., 0])]
    grid = FieldGrid.around(everywhere, 1.0, 160)
    fields = Fields.of(some, grid)
    cell = grid.width / 159
    for row in range(len(some.rows)):
        for step in range(4):
            ahead, truth = some.predicted[row, step], some.actual[row, step]
            field = distance_field(grid, ahead) - distance_field(grid, truth)
            np.testing.assert_allclose(fields.fields[row, step], field)
            assert field.max() <= fields.errors[row, step] + 1e-9
            assert field.max() >= fields.errors[row, step] - 2.0 * cell  # both are 1-Lipschitz


@pytest.fixture(scope="module")
def measured():
    study = replace(
        build("experiments", read_config(CONFIG, [])), cells=16, resamples=8, people=("paired",)
    )
    return study, [row for task in study.tasks() for row in study.measure(task).rows]


def test_constants_keep_the_promise_and_give_up_less(measured):
    study, rows = measured
    table = {line["method"]: line for line in study.summary(rows)}
    assert tuple(table) == METHODS
    for line in table.values():
        assert line["rows"] == sum(r["rows"] for r in rows if r["method"] == line["method"]
                                   and r["window"] >= 0)  # fmt: skip
    for envelope, constant in (("envelope", "constant"), ("joint envelope", "joint constant")):
        assert table[constant]["u_12_m"] < table[envelope]["u_12_m"]
        more = table[envelope]["u_12_m"] - table[constant]["u_12_m"]
        assert table[envelope]["more_u_12_m"] == pytest.approx(more)
    assert table["constant"]["field_step_low"] <= study.tail
    assert table["joint constant"]["field_low"] <= study.tail
    # Of a constant no place is missed more than people's own.
    assert table["constant"]["plan"] == pytest.approx(table["constant"]["field"])


def test_constant_is_the_rank_quantile_of_each_step(measured):
    study, rows = measured
    recorded = study.data.read(study.data.scenes["plaza"])[0]
    own = RecordedCourse(recorded, (0.0, 0.0, 0.0), (0.0, 0.0))
    found = FieldRows.of(own, study.predictor).paired()
    errors = []
    for ahead, truth in zip(found.predicted[:, 5], found.actual[:, 5], strict=True):
        here = truth[np.isfinite(truth[:, 0])]
        if len(here):
            known = ahead[np.isfinite(ahead[:, 0])]
            away = np.linalg.norm(here[:, None] - known, axis=2)
            errors.append(away.min(axis=1).max())
    rank = int(np.ceil(0.9 * (len(errors) + 1)))
    line = next(line for line in study.summary(rows) if line["method"] == "constant")
    assert line["u_6_m"] == pytest.approx(sorted(errors)[rank - 1])


def test_unknown_people_are_refused():
    with pytest.raises(WideberthError, match="people holds 'some'"):
        FieldPrice(people=("some",))
