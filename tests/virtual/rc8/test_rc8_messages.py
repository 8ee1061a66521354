from __future__ import annotations

from datetime import timedelta

import pytest

from orinkit.values.variant import Variant, VarType

NONE_WAITS = 0x80000204


def test_an_error_is_reported_to_every_client(rc8, connect, clock, refused):
    one, two, deaf = connect("one"), connect("two"), connect("deaf", "@EventDisable=true")
    assert refused(one.get_message) == NONE_WAITS
    clock.advance(2)
    rc8.raise_error(0x84201482)
    for client in (one, two):
        message = client.get_message()
        assert message.get_number() == 1
        assert message.get_value() == Variant(VarType.I4, 0x84201482 - 2**32)
        assert message.get_description().startswith("Late set-point")
        assert (message.get_source(), message.get_destination()) == ("RC8 Controller", client.name)
        assert message.get_date_time() == clock.wall() == rc8.state.calendar.now()
        assert message.get_serial_number() == 1
        assert message.get_name() == "Message1"
        assert message.get_help() == message.get_description()
        assert message.reply(Variant(VarType.I4, 1)) is None
        assert message.clear() is None
        message.release()
        assert refused(client.get_message) == NONE_WAITS
    assert refused(deaf.get_message) == NONE_WAITS
    assert deaf.events is None


@pytest.mark.parametrize(
    "option", ["", "@EventDisable=false", "Wpj=*,Interval=8", "@IfNotMember,What=ever,,=", "Message=True", "Message"]
)
def test_events_come_unless_disabled(option, connect, rc8):
    client = connect("c", option)
    rc8.set_mode(1)
    assert client.get_message().get_number() == 2


@pytest.mark.field("3.5")
@pytest.mark.parametrize("option", ["Message=False", "Interval=8, message = 0", "Message=false,Debug=True"])
def test_no_events_come_with_message_false(option, connect, rc8, refused):
    client = connect("c", option)
    rc8.set_mode(1)
    assert refused(client.get_message) == NONE_WAITS
    assert client.events is None


def test_changes_of_mode_and_emergency_stop_are_reported(rc8, controller, refused):
    rc8.set_mode(3)  # the present mode
    rc8.emergency_stop(False)
    assert refused(controller.get_message) == NONE_WAITS
    rc8.set_mode(1)
    rc8.emergency_stop(True)
    rc8.emergency_stop(True)
    rc8.set_mode(2)
    rc8.emergency_stop(False)
    messages = [controller.get_message() for _ in range(4)]
    assert [(m.get_number(), m.get_value().value) for m in messages] == [(2, 1), (3, 1), (2, 2), (3, 0)]
    assert [m.get_serial_number() for m in messages] == [1, 2, 3, 4]
    assert [m.get_description() for m in messages] == [
        "Mode: manual",
        "Emergency stop pressed",
        "Mode: teach check",
        "Emergency stop released",
    ]
    assert refused(controller.get_message) == NONE_WAITS


def test_an_invalid_mode(rc8):
    for mode in (0, 4, -1):
        with pytest.raises(ValueError, match="mode"):
            rc8.set_mode(mode)
    assert rc8.state.switches.mode == 3


def test_notices_are_not_reported(rc8, controller, refused):
    for code in (0x80201418, 0x0F200501, 0):
        rc8.raise_error(code)
    assert refused(controller.get_message) == NONE_WAITS


def test_a_client_that_does_not_fetch_loses_the_oldest(rc8, connect):
    lazy = connect("lazy")
    for number in range(256):
        rc8.raise_error(0x83500121, f"error {number}")
    busy = connect("busy")
    for number in range(256, 300):
        rc8.raise_error(0x83500121, f"error {number}")
    assert (len(lazy.events), lazy.events.dropped) == (256, 44)
    assert (len(busy.events), busy.events.dropped) == (44, 0)
    first = lazy.get_message()
    assert (first.get_description(), first.get_serial_number()) == ("error 44", 45)
    assert busy.get_message().get_description() == "error 256"


def test_a_client_that_has_left_gets_no_more(rc8, connect):
    gone, still = connect("gone"), connect("still")
    queue = gone.events
    gone.release()
    gone.release()
    rc8.set_mode(1)
    assert (len(queue), len(still.events)) == (0, 1)
    connect("deaf", "@EventDisable").release()
    texts = [record.text for record in (rc8.state.operations.at(i) for i in range(len(rc8.state.operations)))]
    assert texts.count("Client disconnected") == 2


def test_the_time_of_an_event_is_the_controllers(rc8, controller, clock):
    before = clock.wall()
    rc8.state.calendar.set(before + timedelta(days=400))
    rc8.set_mode(1)
    assert controller.get_message().get_date_time() == before + timedelta(days=400)
