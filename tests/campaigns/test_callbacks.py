"""Who follows a campaign is told what it does and why."""

from butterfly.campaigns.campaign import CampaignCallbacks
from tests.campaigns.robots import Faulty, run


class Heard(CampaignCallbacks):
    """Keeps what it is told, and how many commands there were by then."""

    def __init__(self, motor):
        self._motor, self.announced, self.phases, self.cycles = motor, None, [], 0

    def begin(self, announcement):
        self.announced = len(self._motor.commands), " ".join(announcement)

    def phase(self, sentence):
        self.phases.append(sentence)

    def cycle(self, *_):
        self.cycles += 1


def test_a_campaign_says_what_it_does_and_why_and_ends_at_rest(tmp_path):
    motor = Faulty("")
    heard = Heard(motor)
    found = run(motor, tmp_path / "a", callbacks=heard)
    commands, announcement = heard.announced
    assert commands == 0
    assert "Limits: command 0.15 unit, angle 1 rad from rest" in announcement
    assert heard.cycles > 1000
    begins = [sentence for sentence in heard.phases if ": to " in sentence or "gives" in sentence]
    assert [sentence[:5] for sentence in begins] == [f"Run {k}" for k in range(len(begins))]
    assert len(begins) == len(found.rows())
    assert all("s of robot time" in sentence for sentence in begins)
    assert "to test the prediction on a held-out run" in begins[-1]
    assert motor.stopped == len(found.rows()) + 1  # after contact and after each run
    before, after = motor.last_readings
    assert abs(after) < 0.05
    assert abs(after - before) < 1e-3
