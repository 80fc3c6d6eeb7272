"""Whatever is done to an input, a verb says what is wrong with it or does its work."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from studies.mutations import COMMANDS, Outcome, make_inputs, mutate, outcomes, run, table
from tacstrip.core.binding import exported

# Without the compiled core a track takes minutes.
VERBS = tuple({words[0] for words in COMMANDS} - ({"track"} if exported("rigid_descend") is None else set()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("mutations")
    make_inputs(made)
    return made


def _wrong(found: list[Outcome]) -> list[Outcome]:
    return [one for one in found if one.wrong]


def test_a_few_mutated_inputs_to_every_verb(folder: Path) -> None:
    found = list(outcomes(folder, 4, 20261122, VERBS))
    assert not _wrong(found), table(found)
    assert {one.code for one in found} == {0, 1, 2}


@pytest.mark.slow
def test_a_thousand_mutated_inputs_to_every_verb(folder: Path) -> None:
    found = list(outcomes(folder, 1000, 14))
    assert len(found) >= 1000 * len({words[0] for words in COMMANDS})
    assert not _wrong(found), table(found)


def test_inputs_that_were_not_mutated_are_good(folder: Path) -> None:
    """Else nothing would be tested but the first error."""
    for words in COMMANDS:
        if words[0] in ("simulate", "convert", "recover", "replay", "spice"):
            code, _, said, wrong = run(folder, [word.lstrip("@%") for word in words])
            assert (code, wrong) == (0, ""), said
            for left in folder.glob("out.*"):
                left.unlink()


def test_mutations_change_files_and_repeat_with_their_seed(folder: Path) -> None:
    for name in ("r.csv", "s.toml", "runs.csv", "r.mcap"):
        data, kind = (folder / name).read_bytes(), Path(name).suffix
        made = [mutate(data, kind, np.random.default_rng(seed)) for seed in range(40)]
        assert made == [mutate(data, kind, np.random.default_rng(seed)) for seed in range(40)]
        assert sum(changed != data for _, changed, _ in made) > 30
        assert len({what for what, _, _ in made}) > 5


def test_what_is_wrong_is_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A verb that fails on everything, or takes everything, does not pass."""

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("studies.mutations.main", broken)
    assert all("ZeroDivisionError" in one.wrong for one in outcomes(folder, 2, 0, ["spice"]))
    monkeypatch.setattr("studies.mutations.main", lambda: None)
    assert any("a number that is none was taken" in one.wrong for one in outcomes(folder, 30, 0, ["spice"]))
