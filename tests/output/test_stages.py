"""The clock of a long piece of work."""

from fpjax.output.stages import StageClock
from fpjax.output.work_done import WorkDone


def test_a_stage_that_comes_again_is_added_to():
    # read when a stage begins and when it ends
    now = iter([0.0, 1.0, 1.0, 3.0, 3.0, 6.0])
    clock = StageClock(now=lambda: next(now))
    for name in ("fit", "look", "fit"):
        clock(name)
    clock.end()
    clock.end()
    assert clock.seconds == {"fit": 4.0, "look": 2.0}


def test_parts_of_a_stage_are_told_and_counted_together():
    now = iter([0.0, 1.0, 1.0, 3.0, 3.0, 4.0])
    told: list[tuple[str, float]] = []
    clock = StageClock(lambda stage, share: told.append((stage, share)), now=lambda: next(now))
    clock("diagnose: fit", 0.25)
    clock("diagnose: judge", 0.5)
    clock("searching", 0.75)
    clock.done()
    assert clock.seconds == {"diagnose": 3.0, "searching": 1.0}
    assert told == [("diagnose: fit", 0.25), ("diagnose: judge", 0.5), ("searching", 0.75), ("done", 1.0)]


def test_a_work_that_is_a_stage_itself_comes_before_all_that_have_costs():
    told: list[float] = []
    clock = StageClock(lambda stage, share: told.append(share), {"search": (1.0, 2.0, 4.0)})
    clock("diagnose: fit", WorkDone(2.0, 0.0, 0.0))
    assert isinstance(told[-1], WorkDone)
    assert (told[-1].done, told[-1].least, told[-1].most) == (2.0, 1.0, 4.0)
    clock("search", 0.5)
    assert told[-1] == 0.75
    clock.done()
    assert told[-1] == 1.0
