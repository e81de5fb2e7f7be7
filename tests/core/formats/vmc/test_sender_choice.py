"""Several programs that send to one port."""

from perfanim.core.formats.vmc.sender_choice import LIMITS, SenderChoice, Source

FIRST, SECOND = ("127.0.0.1", 5001), ("127.0.0.1", 5002)


def heard(choice: SenderChoice, packets: list[tuple[Source, float]]) -> list[Source]:
    return [source for source, time_s in packets if choice.accepts(source, time_s)]


def test_the_first_program_is_kept() -> None:
    choice = SenderChoice()
    packets = [(source, 0.01 * number) for number in range(50) for source in (FIRST, SECOND, SECOND, SECOND)]
    assert set(heard(choice, packets)) == {FIRST}
    assert choice.others == {SECOND}


def test_another_one_follows_a_program_that_has_ended() -> None:
    choice = SenderChoice()
    assert heard(choice, [(FIRST, 0.0), (SECOND, 0.5), (SECOND, 0.1 + LIMITS.silence_s), (FIRST, 1.2)]) == [
        FIRST,
        SECOND,
    ]


def test_a_program_with_a_new_port_for_each_packet_is_heard() -> None:
    choice = SenderChoice()
    packets = [(("192.168.1.9", 6000 + number), 0.01 * number) for number in range(40)]
    assert len(heard(choice, packets)) >= 38
    assert not choice.others
    assert not choice.accepts(("192.168.1.7", 5001), 0.4)
