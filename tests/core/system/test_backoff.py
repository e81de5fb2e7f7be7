from perfanim.core.system.backoff import Backoff


def test_waits_double_up_to_the_longest():
    backoff, attempts = Backoff(1.0, 4.0), []
    for now in range(20):
        if backoff.is_due(float(now)):
            attempts.append(now)
            backoff.attempt(float(now))
    assert attempts == [1, 3, 7, 11, 15, 19]


def test_a_reset_begins_with_the_first_wait():
    backoff = Backoff(1.0)
    assert not backoff.is_due(0.0)
    backoff.attempt(1.0)
    backoff.reset(5.0)
    assert not backoff.is_due(5.5)
    assert backoff.is_due(6.0)
