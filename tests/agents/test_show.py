"""``crowd-env show`` films the rule beside what was learned."""

import pytest
from cases import looped
from commands import call

PIL_Image = pytest.importorskip("PIL.Image")

SMALL = "--film-width 320 --film-fps 1"


@pytest.mark.more
def test_by_default_the_rule_blocks_the_door_and_the_learned_crowd_walks_out(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("crowd_env.rendering.libraries.film_suffix", lambda: ".gif")
    result = call(f"show {SMALL}")
    assert result.exit_code == 0, result.output
    rule, learned = result.stdout.splitlines()
    assert rule.startswith("rule: full speed ahead: ") and "still inside after" in rule
    assert learned.startswith("learned: ppo: all out after ")
    assert float(rule.split()[-2]) == pytest.approx(
        1.3 * float(learned.split()[-2]), abs=0.2
    )  # no longer is worth a look
    with PIL_Image.open(tmp_path / "competitive-door.gif") as film:
        assert film.size[0] == 320 and film.n_frames > 10


def test_without_a_shipped_policy_the_rule_is_shown_alone(tmp_path):
    result = call(f"show room --film {tmp_path / 'a.png'}")
    assert result.exit_code == 0 and len(result.stdout.splitlines()) == 1, result.output
    assert "no policy is shipped for room" in result.stderr
    assert (tmp_path / "a.png").exists()


@looped(
    ("line", "words"),
    [
        ("show no-such-task", "no-such-task competitive-door"),
        ("show --policies nobody", "nobody density-cap"),
        ("show --film a.avi", "a.avi .mp4"),
        ("show --seed -1", "--seed 0"),
        ("show --film-width 3", "--film-width 160"),
    ],
)
def test_a_mistake_is_told_before_anything_runs(line, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call(line)
    assert result.exit_code == 2 and not list(tmp_path.iterdir())
    assert all(word in result.stderr for word in words.split()), result.stderr
