"""Values that settings may have, and those that are refused before anything is begun."""

import dataclasses

import pytest

from solver.fit import limits
from solver.fit.errors import SettingsError
from solver.fit.presets import PRESETS, settings_for
from solver.fit.schedule import smoothing_width
from solver.fit.settings import Settings


def fields():
    for section in dataclasses.fields(Settings):
        for field in dataclasses.fields(section.default_factory):
            yield f"{section.name}.{field.name}"


def test_limits_are_those_of_settings_that_exist():
    tables = (limits.CHOICES, limits.LEAST, limits.MOST, limits.DECIDED_ELSEWHERE)
    assert {key for table in tables for key in table} | set(limits.RISING) <= set(fields())


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_keeps_within_the_limits(preset):
    for key in set(fields()) - set(limits.DECIDED_ELSEWHERE):
        section, name = key.split(".")
        value = getattr(getattr(PRESETS[preset], section), name)
        assert limits.problem_of(key, value) is None, key


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("fit.steps=0", "1 or more"), ("fit.rays=-1", "1 or more"), ("asset.texture_size=0", "16 or more"),
        ("fit.learning_rate_grid=nan", "finite"), ("field.initial_albedo=1.5", "0.999 or less"),
        ("fit.neural_fade=0.9,0.1", "increase"), ("field.sizes=64,32,16", "increase"),
        ("fit.background=whte", "choose one of auto"), ("fit.exposure=gian", "white_balance"),
        ("render.retrace_choice=nosy", "systematic, noisy"), ("fit.checkpoint_every=inf", "finite"),
        ("render.neural=0.5", "fit.neural_start"), ("render.widening_gradient=no", "fit.unbiased"), ("photos.most_pixels=-1", "0 or more"),
        ("field.step_smoothing=0.05,0", "two zeros"), ("photos.colour_space=aces", "auto, srgb, linear"),
    ],
)  # fmt: skip
def test_a_value_that_cannot_be_is_refused_with_its_name_and_what_may_be(setting, words):
    key, value = setting.split("=")
    with pytest.raises(SettingsError, match=f"'{key}'.*{words}"):
        settings_for("draft", {key: value})


def test_a_smoothing_that_ends_at_none_fades_on_the_way():
    field = settings_for("draft", {"field.smoothing": "0.05,0"}).field
    widths = [smoothing_width(field, fraction) for fraction in (0.0, 0.5, 1.0)]
    assert widths == pytest.approx([0.05, 0.025, 0.0])
