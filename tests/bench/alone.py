"""What the behaviour itself takes of a slot: its pure classes, fed once more with what a run gave them."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import emulator.run as product
from agent.behaviours.dissemination.disseminate import Exchange
from agent.behaviours.dissemination.distances import distance_function
from agent.behaviours.dissemination.estimates import Estimate, EstimateTable, News
from agent.behaviours.dissemination.geodesy import TangentPlane
from agent.behaviours.dissemination.selection import selection
from agent.behaviours.dissemination.wire import ESTIMATE_BYTES, Wire
from channels.units import to_ns
from emulator.run import Options
from emulator.scenario import Scenario, team_ids
from logs.reader import LogReader
from tests.bench.measure import Figures, Meter, SampleFailed
from tests.bench.product import WARM_UP_S, Workload, scenario_of


@dataclass(frozen=True)
class _Slot:
    """One slot as it was."""

    start_ns: int
    state: Estimate
    """The sender's own, which no packet tells to the last bit."""
    packet: bytes
    receivers: list[int]


def measure_alone(workload: Workload, robots: int, duration_s: float) -> Figures:
    """Cost per slot of table, distances, selection and packets; in one process, and nothing around them.

    Raises SampleFailed where the classes say anything else than the robots of the run did.
    """
    scenario = scenario_of(workload, robots, duration_s)
    slots = _slots_of_run(scenario, robots)
    team = _Team(scenario, robots)
    meter, warm, wrong = Meter([]), 0, 0
    for slot in slots:
        if slot.start_ns >= to_ns(WARM_UP_S[workload]):
            if not warm:
                meter.begin()
            warm += 1
        wrong += team.take(slot) != slot.packet
    meter.end()
    if wrong:
        raise SampleFailed(f"{wrong} of {len(slots)} packets differ from those of the run")
    return meter.per_activation(warm)


class _Team:
    """What `disseminate.Exchange` makes of the params, without a robot."""

    def __init__(self, scenario: Scenario, robots: int) -> None:
        params = scenario.params
        latitude, longitude = params.get("origin_deg", (0.0, 0.0))
        self._m = _units(scenario)
        self._wire = Wire(TangentPlane((latitude, longitude)), robots)
        self._distances = distance_function(params["distance"], params.get("link_range_m"))
        self._tables = [EstimateTable(number, robots) for number in range(robots)]
        self._selections = [
            selection(params["scheme"], number, robots, alpha=params["alpha"],
                      new_estimates=params["new_estimates"]) for number in range(robots)
        ]  # fmt: skip
        self._inboxes: list[list[bytes]] = [[] for _ in range(robots)]

    def take(self, slot: _Slot) -> bytes:
        """One slot: its owner hears, chooses and packs; returns its packet."""
        number = slot.state.number
        table, chooser = self._tables[number], self._selections[number]
        for packet in self._inboxes[number]:
            for estimate in self._wire.unpack(packet):
                if table.receive(estimate) is News.first:
                    chooser.heard_first(estimate.number)
        self._inboxes[number].clear()
        table.update_own(slot.state)
        distances = self._distances(number, table.listed())
        chosen = chooser.choose(self._m, distances, table.stamps())
        packet = self._wire.pack(estimate for j in chosen if (estimate := table[j]) is not None)
        for receiver in slot.receivers:
            self._inboxes[receiver].append(packet)
        return packet


def _units(scenario: Scenario) -> int:
    tdma = scenario.radio.tdma
    if tdma is None or tdma.units is None or tdma.unit_bits != 8 * ESTIMATE_BYTES:
        raise SampleFailed(f"{scenario.name}: its slots do not hold a whole number of estimates")
    return tdma.units


def _slots_of_run(scenario: Scenario, robots: int) -> list[_Slot]:
    """All slots of a run that ended before it did. Raises SampleFailed where it had anything but slots."""
    with tempfile.TemporaryDirectory(prefix="heliograph-bench-") as folder, _noting() as states:
        log = Path(folder) / "bench.mcap"
        outcome = product.run(scenario, Options(out=log, fleet="in_process", echo=None))
        if outcome.progress.activations != robots + len(states):  # each was started, and then had its slots
            raise SampleFailed(f"{outcome.progress.activations} activations, but {len(states)} slots")
        with LogReader(log) as reader:
            radio = list(reader.records("/radio"))
    # The last slot may not have ended.
    if not 0 <= len(states) - len(radio) <= 1:
        raise SampleFailed(f"{len(states)} slots, but {len(radio)} transmissions")
    number = {name: place for place, name in enumerate(team_ids(scenario))}
    return [
        _Slot(
            ended_ns - record["airtime_ns"],
            state,
            base64.b64decode(record["payload"]["base64"]),
            [number[name] for name in record["delivered"]],
        )
        for state, (ended_ns, record) in zip(states, radio, strict=False)
    ]


@contextmanager
def _noting() -> Iterator[list[Estimate]]:
    """The own states that robots of this process find at the start of their slots, in order."""
    states: list[Estimate] = []
    state = Exchange.state

    def noted(exchange: Exchange) -> Estimate:
        states.append(state(exchange))
        return states[-1]

    with patch.object(Exchange, "state", noted):
        yield states
