"""The ways of people on a page are those of the recording, also where frames are left out."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from replayed_pages import walk_out

from crowd_env.recording import Recording
from crowd_env.rendering.replay.tracks import Tracks, contacts_of, thinned_frames, tracks_of


def sample_times(tracks: Tracks) -> np.ndarray:
    """Return the time of each sample (S,) [s]."""
    times = [
        np.append(tracks.times[first : first + count - 1], until)
        for first, count, until in zip(tracks.first, tracks.samples, tracks.until, strict=True)
    ]
    return np.concatenate(times)


def without_rows(recording: Recording, gone: np.ndarray) -> Recording:
    """Return a recording without the rows (R,) that are ``gone``."""
    kept = np.concatenate([[0], np.cumsum(~gone)])
    rows = {name: getattr(recording, name)[~gone] for name in ("person", "position", "velocity", "pressure")}
    return replace(recording, frame_start=kept[recording.frame_start], **rows)


def test_all_frames_are_the_rows_person_by_person() -> None:
    recording = walk_out(8, stays=2)
    tracks = tracks_of(recording, thinned_frames(recording, 10**6))
    order = np.argsort(recording.person, kind="stable")
    np.testing.assert_allclose(np.stack([tracks.x, tracks.y], axis=1), recording.position[order], atol=1e-9)
    np.testing.assert_allclose(tracks.pressure, recording.pressure[order], atol=1e-6)
    np.testing.assert_allclose(tracks.speed, np.linalg.norm(recording.velocity[order], axis=1))
    np.testing.assert_allclose(sample_times(tracks), recording.times[recording.frame[order]])


@looped("most", [150, 60, 20, 1])
def test_thinning_keeps_ways_beginnings_ends_and_the_bound(most: int) -> None:
    recording = walk_out(12, stays=3)
    frames = thinned_frames(recording, most)
    tracks = tracks_of(recording, frames)
    assert frames[0] == 0 and frames[-1] == len(recording.times) - 1
    assert len(tracks.x) <= most + 3 * 12  # first and last frame, and the last row of each
    # A straight way stays straight: everyone is where the walk of 1 m/s leads, at every time kept.
    who = np.repeat(np.arange(12), tracks.samples)
    start = recording.position[:12, 0]
    speed = np.where(who >= 9, 0.0, 1.0)
    np.testing.assert_allclose(tracks.x, start[who] + speed * sample_times(tracks), atol=1e-9)
    for n in range(9):  # the last moment of each person is beyond the exit
        assert tracks.x[tracks.samples[: n + 1].sum() - 1] > 6.0


def test_pressure_is_averaged_over_the_frames_that_are_left_out() -> None:
    recording = walk_out(6)
    whole, thin = (tracks_of(recording, thinned_frames(recording, most)) for most in (10**6, 60))

    def borne(tracks: Tracks) -> np.ndarray:
        """Return the pressure summed over time for each person, from the first frame on [N s/m]."""
        step = np.diff(sample_times(tracks), prepend=0.0)
        starts = np.concatenate([[0], np.cumsum(tracks.samples)[:-1]])
        step[starts] = 0.0
        return np.add.reduceat(step * tracks.pressure, starts)

    assert len(thin.times) < len(whole.times)
    np.testing.assert_allclose(borne(thin), borne(whole), rtol=1e-9)


def test_who_was_not_seen_for_a_while_walks_straight() -> None:
    recording = walk_out(4)
    gap = (recording.person == 1) & (recording.frame > 3) & (recording.frame < 9)
    whole = tracks_of(recording, np.arange(len(recording.times)))
    holed = tracks_of(without_rows(recording, gap), np.arange(len(recording.times)))
    np.testing.assert_array_equal(holed.samples, whole.samples)
    np.testing.assert_allclose(holed.x, whole.x, atol=1e-9)


def test_who_comes_late_is_shown_from_then_on_and_who_never_comes_is_not() -> None:
    recording = walk_out(4)
    late = ((recording.person == 1) & (recording.frame < 7)) | (recording.person == 2)
    tracks = tracks_of(without_rows(recording, late), np.arange(0, len(recording.times), 3))
    assert tracks.first[1] == 3 and tracks.samples[1] > 0
    assert tracks.samples[2] == 0


def test_contacts_of_the_frames_that_are_kept() -> None:
    recording = walk_out(6, contacts=True)
    assert recording.contacts is not None
    frames = thinned_frames(recording, 60)
    kept = contacts_of(recording, frames)
    assert kept is not None
    for k, frame in enumerate(frames):
        here = np.s_[recording.contacts.start[frame] : recording.contacts.start[frame + 1]]
        np.testing.assert_array_equal(kept.i[kept.start[k] : kept.start[k + 1]], recording.contacts.i[here])


def test_angles_do_not_jump_by_full_turns() -> None:
    recording = walk_out(3, outline="torso")
    assert recording.angle is not None
    turned = replace(recording, angle=np.angle(np.exp(1j * recording.times[recording.frame] * 2.0 + 2.5j)))
    tracks = tracks_of(turned, np.arange(len(recording.times)))
    assert tracks.angle is not None
    inner = np.repeat(np.arange(3), tracks.samples)
    jumps = np.diff(tracks.angle)[np.diff(inner) == 0]
    np.testing.assert_allclose(jumps, 2.0 * np.diff(sample_times(tracks))[np.diff(inner) == 0], atol=1e-9)


@pytest.mark.parametrize("most", [10**6, 60])
def test_who_stays_inside_stays_on_the_page_when_the_last_frame_holds_only_those_who_got_out(most: int) -> None:
    recording = walk_out(8, stays=2)
    last = len(recording.times) - 1
    cut = without_rows(recording, (recording.person >= 6) & (recording.frame == last))
    assert not {6, 7} & set(cut.person[cut.frame == last])
    whole, kept = (tracks_of(one, thinned_frames(one, most)) for one in (recording, cut))
    np.testing.assert_array_equal(kept.samples, whole.samples)
    np.testing.assert_allclose(kept.until, whole.until)
    np.testing.assert_allclose(np.stack([kept.x, kept.y]), np.stack([whole.x, whole.y]), atol=1e-9)
    held = recording.pressure[(recording.person == 7) & (recording.frame == last - 1)]
    assert kept.pressure[-1] == pytest.approx(held, rel=0.2)  # and what pressed on them does not end
