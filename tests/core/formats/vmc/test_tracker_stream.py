"""Trackers by VMC as marker frames: which marker each is, when a frame is whole, its number and time."""

import numpy as np
import pytest
from perfanim.core.formats.vmc.frame_assembler import LIMITS
from perfanim.core.formats.vmc.tracker_stream import TrackerStream
from perfanim.core.formats.vmc.vmc_packets import TRACKERS
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import Marker, MarkerSet, load_marker_set
from trackers_sent import tracker_packet

BOXING = load_marker_set("boxing")
PLACES = {name: np.array([0.1 * at, 1.0, -0.2 * at]) for at, name in enumerate(BOXING.names)}


def worn(*names):
    """These markers, and three of a torso that nobody sends."""
    return MarkerSet("worn", tuple(Marker(name, "root", np.zeros(3), True) for name in (*names, "A", "B", "C")))


def by_marker(frame, count):
    points = np.full((count, 3), np.nan)
    points[frame.labels] = frame.points_m
    return points


def test_a_bundle_is_a_frame_at_once_from_the_second_on():
    stream = TrackerStream(BOXING)
    assert stream.add(tracker_packet(PLACES), 5.0) == []  # more of it might come
    frames = [stream.add(tracker_packet(PLACES), 5.0 + at / 60) for at in range(1, 4)]
    assert [len(ended) for ended in frames] == [2, 1, 1]
    for frame in (frame for ended in frames for frame in ended):
        np.testing.assert_allclose(by_marker(frame, len(BOXING)), list(PLACES.values()), atol=1e-6)
    first, second = frames[0]
    assert (first.number, second.number, frames[1][0].number, frames[2][0].number) == (0, 1, 2, 3)
    assert second.time_s - first.time_s == pytest.approx(1 / 60)
    assert stream.trackers == BOXING.names


def test_a_frame_spread_over_packets_waits_for_all_of_them_and_not_for_one_that_is_gone():
    stream = TrackerStream(worn("head", "waist"))
    head, waist, bones = (tracker_packet({name: (0.0, 1.0, 0.0)}) for name in ("head", "waist", "chest"))
    stream.add(head, 0.0)
    stream.add(waist, 0.0)
    assert [len(frame.labels) for frame in stream.add(head, 0.1)] == [2]
    assert [len(frame.labels) for frame in stream.add(waist, 0.1)] == [2]  # as whole as the last: at once
    assert stream.add(head, 0.2) == []
    assert [len(frame.labels) for frame in stream.add(head, 0.3)] == [1, 1]  # waist is hidden from now on
    assert [len(frame.labels) for frame in stream.add(head, 0.4)] == [1]
    assert stream.add(bones, 0.5) == []
    assert stream.trackers == ("head", "waist")  # of the frame that is open still nothing is known
    assert stream.add(b"noise", 0.6) == []
    assert (stream.gathering.packets, stream.gathering.malformed) == (9, 1)


def test_names_agree_as_those_of_takes_and_others_are_left_out():
    hips = Marker("Waist", "root", np.zeros(3), True, also=("LHR-4F1",))
    stream = TrackerStream(MarkerSet("worn", (Marker("L.Hand", "lhand", np.zeros(3)), hips, *worn().markers)))
    packet = tracker_packet({"LHR-4f1": (0.0, 1.0, 0.0), "chair": (2.0, 0.0, 0.0), "l_hand": (0.5, 1.0, 0.1)})
    stream.add(packet, 0.0)
    frame = stream.add(packet, 0.1)[0]
    assert list(frame.labels) == [1, 0]
    np.testing.assert_allclose(frame.points_m, [[0.0, 1.0, 0.0], [0.5, 1.0, 0.1]], atol=1e-6)
    stranger = TrackerStream(BOXING)
    assert [stranger.add(packet, at / 60) for at in range(3)] == [[], [], []]
    assert stranger.trackers == ("LHR-4f1", "chair", "l_hand")


@pytest.mark.parametrize("address", TRACKERS)
def test_how_a_tracker_is_turned_is_told_by_points_on_its_axes(address):
    turn = rot.from_rotation_vector(np.array([0.3, -0.8, 0.5]))
    place = np.array([0.2, 1.0, -0.4])
    stream = TrackerStream(worn("waist", "waist x", "waist y", "waist z"))
    packet = tracker_packet({"waist": place}, {"waist": turn}, address)
    stream.add(packet, 0.0)
    points = by_marker(stream.add(packet, 0.1)[0], 4)
    np.testing.assert_allclose(points[0], place, atol=1e-6)
    np.testing.assert_allclose(points[1:], place + rot.rotate(turn, 0.1 * np.eye(3)), atol=1e-6)


def test_a_pause_leaves_numbers_out_and_crowded_packets_keep_their_order():
    stream, packet = TrackerStream(BOXING), tracker_packet(PLACES)
    arrivals_s = np.concatenate((np.arange(60) / 50, 60 / 50 + 2.0 + np.arange(60) / 50))
    held_up = slice(30, 34)
    arrivals_s[held_up] = arrivals_s[33] + 1e-5 * np.arange(4)
    frames = [frame for arrival_s in arrivals_s for frame in stream.add(packet, float(arrival_s))]
    assert len(frames) == 120
    numbers, times_s = np.array([f.number for f in frames]), np.array([f.time_s for f in frames])
    assert list(numbers[:60]) == list(range(60))
    assert numbers[60] == pytest.approx(60 + 2.0 * 50, abs=2)  # the rate is known as well as stamps tell it
    assert np.all(np.diff(times_s) > 0.0)
    assert np.abs(times_s - (arrivals_s - arrivals_s[0])).max() < 4 / 50  # never further off than what was held up


def test_a_program_that_makes_up_names_fills_no_memory_and_hides_no_marker():
    stream, most = TrackerStream(BOXING), 0
    for at in range(40):
        stream.add(tracker_packet({f"{at}-{i}": (0, 1, 0) for i in range(100)}), at / 60)
        most = max(most, len(stream.trackers))
    assert 0 < most <= 2 * LIMITS.placed
    stream.add(tracker_packet(PLACES), 1.0)
    (frame,) = stream.add(tracker_packet(PLACES), 1.1)[-1:]
    assert len(frame.labels) == len(BOXING)


@pytest.mark.parametrize(("packet", "most"), [(b"junk", LIMITS.packets), (bytes(60_000), LIMITS.size // 60_000)])
def test_of_a_flood_no_more_is_read_than_a_second_may_bring(packet, most):
    stream = TrackerStream(BOXING)
    for _ in range(most + 100):
        stream.add(packet, 5.5)
    gathering = stream.gathering
    assert (gathering.packets, gathering.malformed, gathering.flooding) == (most + 100, most, 100)
    stream.add(tracker_packet(PLACES), 6.0)
    assert stream.gathering.flooding == 101  # the same second
    stream.add(tracker_packet(PLACES), 6.6)
    frames = stream.add(tracker_packet(PLACES), 6.7)
    assert [len(frame.labels) for frame in frames] == [len(BOXING)] * 2
    assert gathering.flooding == 101
