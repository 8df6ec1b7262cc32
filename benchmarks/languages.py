"""What it costs to check a mission: 1,000 nodes in sub-trees with recovery, beyond the start of the program.

python benchmarks/languages.py [--nodes 1000] [--runs 9]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

from picktree.authoring import check_mission
from picktree.files.yaml import read_document
from picktree.trees.loading import NodeRegistry

HEAD = "picktree: 1\nkind: mission\nname: large\nscene: three_bins\ntrees:\n"
MAIN = """\
  Main:
    Repeat:
      while: items_left
      num_cycles: 4
      do:
        Sequence:
          - Observe: {camera: overhead, objects: "{items}"}
"""
STATION = """\
  Station{n}:
    ports: {{item: {{type: object}}, force: {{type: float, unit: N, default: 30 N}}}}
    Recover:
      attempts: 3
      do:
        Sequence:
          - IfThenElse:
              - Condition: {{if: "item.colour == 'red' and not holding"}}
              - Grasp: {{object: "{{item}}", force: "{{force}}"}}
              - Grasp: {{object: "{{item}}"}}
          - Timeout: {{msec: 60 s, do: {{Place: {{object: "{{item}}", into: "{{item.destination}}"}}}}}}
      when:
        planning.*: [{{Observe: {{camera: overhead}}}}]
        grasp.missed: [SafeRetreat, {{Observe: {{camera: overhead}}}}]
        grasp.slipped: [SafeRetreat, {{Observe: {{camera: overhead}}}}]
        control.*: [SafeRetreat]
      otherwise: [SafeRetreat]
      give_up: [{{SafeRetreat: {{hand: open}}}}]
"""
CALL = """\
          - ForEach:
              in: "{{items}}"
              out: "{{item}}"
              on_failure: continue
              do: {{Station{n}: {{item: "{{item}}"}}}}
"""


def text_of(nodes: int) -> str:
    """A mission of about that many nodes as written in the file."""
    stations = max(1, round(nodes / 22))
    calls = "".join(CALL.format(n=n) for n in range(stations))
    return HEAD + MAIN + calls + "".join(STATION.format(n=n) for n in range(stations))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=9)
    options = parser.parse_args()
    began = time.perf_counter()
    registry = NodeRegistry()
    registry.ids()
    print(f"{'nodes of all skills imported':<36} {time.perf_counter() - began:7.3f} s")
    text = text_of(options.nodes)
    path = Path("large.yaml")
    found = check_mission(read_document(path, "mission", text), registry)
    assert found.mission is not None, "\n".join(map(str, found.faults))
    count = sum(1 for tree in found.mission.trees.values() for _ in tree.root.iterate())
    print(f"{count} nodes in {len(found.mission.trees)} trees, {len(text) / 1000:.0f} kB")
    document = read_document(path, "mission", text)
    timed("YAML with places", lambda: read_document(path, "mission", text), options.runs)
    timed("check: language, names, linter", lambda: check_mission(document, registry), options.runs)


def timed(name: str, action: Callable[[], object], runs: int) -> None:
    seconds: list[float] = []
    for _ in range(runs):
        began = time.process_time()
        action()
        seconds.append(time.process_time() - began)
    spread = f"{min(seconds):.3f} … {max(seconds):.3f}"
    print(f"{name:<36} {statistics.median(seconds):7.3f} s CPU, median of {runs} ({spread})")


if __name__ == "__main__":
    main()
