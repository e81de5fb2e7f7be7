"""One person, found and followed through the pictures of one camera."""

import numpy as np
import pytest
from filmed_people import POINTS, FakeNetwork, picture
from perfanim.core.vision.people.person_follower import PersonFollower, find_other

PERSON = np.random.default_rng(0).uniform((-40.0, -90.0), (40.0, 90.0), (len(POINTS), 2))


def walks(start, step, count):
    return {n: PERSON + np.array(start) + n * np.array(step) for n in range(count)}


@pytest.mark.parametrize("at", [(320, 240), (60, 150), (590, 380)])
def test_a_person_anywhere_in_the_first_picture_is_found(at):
    found = PersonFollower(FakeNetwork(walks(at, (0, 0), 1)), tries=1000).step(picture(0))
    np.testing.assert_allclose(found.pixels, PERSON + np.array(at))


def test_the_person_is_followed_with_one_crop_a_picture():
    network = FakeNetwork(walks((100, 200), (4, 0), 100))
    follower = PersonFollower(network, tries=1000)
    assert follower.step(picture(0))
    before = network.calls
    assert all(follower.step(picture(n)) for n in range(1, 100))
    assert network.calls == before + 99


def test_a_live_search_tries_few_crops_in_each_picture_and_goes_on_in_the_next():
    network = FakeNetwork(walks((60, 150), (0, 0), 200))
    follower = PersonFollower(network, tries=4)
    for n in range(200):
        before = network.calls
        found = follower.step(picture(n))
        assert network.calls - before <= 4 + 3  # and the person again in their own crops
        if found:
            break
    assert found and n > 0


def test_a_lost_person_is_found_again_where_they_come_back():
    pixels = walks((320, 240), (0, 0), 10) | {n: PERSON + np.array((120, 200)) for n in range(40, 60)}
    follower = PersonFollower(FakeNetwork(pixels), tries=1000)
    found = [follower.step(picture(n)) is not None for n in range(60)]
    assert found[:10] == [True] * 10
    assert found[10:40] == [False] * 30
    assert all(found[41:])


def test_nobody_is_found_in_pictures_without_a_person():
    network = FakeNetwork({})
    follower = PersonFollower(network, tries=10)
    assert [follower.step(picture(n)) for n in range(50)] == [None] * 50
    assert 300 < network.calls <= 500  # the search begins anew when it has been everywhere


def test_somebody_else_is_found_beside_the_person():
    """The network knows one of the two: the person who is not followed, or only the one who is."""
    own, other = PERSON + np.array((150, 240)), PERSON + np.array((500, 200))
    found = find_other(FakeNetwork({0: other}), picture(0), own)
    np.testing.assert_allclose(found.pixels, other)
    assert find_other(FakeNetwork({0: own}), picture(0), own) is None


def test_furniture_is_not_somebody_else():
    network = FakeNetwork({0: PERSON + np.array((500, 200))}, score=0.83)
    assert find_other(network, picture(0), PERSON + np.array((150, 240))) is None
