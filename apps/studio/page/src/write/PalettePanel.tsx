// The nodes that may be added: search, then Enter or a click adds below the selected node; or drag one onto a node.

import { useMemo, useState } from "react";
import type { DragEvent, KeyboardEvent } from "react";

import { NodeSymbol } from "../ui/Icon";
import { Prose, plain } from "../ui/Prose";
import type { NodeEntry, Palette } from "./model";

export const DRAGGED = "application/x-picktree-node";

const GROUPS: [kind: string, title: string][] = [
  ["subtree", "Sub-trees"], ["action", "Actions"], ["condition", "Conditions"], ["control", "Control nodes"], ["decorator", "Decorators"],
];

export function PalettePanel({ palette, target, add }: { palette: Palette; target: string; add(entry: NodeEntry): void }) {
  const [search, setSearch] = useState("");
  const [chosen, setChosen] = useState(0);
  const found = useMemo(() => ranked(palette.nodes, search), [palette, search]);
  const groups = GROUPS.map(([kind, title]) => ({ title, nodes: found.filter((each) => each.kind === kind) })).filter((group) => group.nodes.length);
  const order = search ? found : groups.flatMap((group) => group.nodes);
  const here = order[Math.min(chosen, order.length - 1)];
  const keys = (event: KeyboardEvent) => {
    const step = event.key === "ArrowDown" ? 1 : event.key === "ArrowUp" ? -1 : 0;
    if (step) {
      event.preventDefault();
      setChosen(Math.min(Math.max(Math.min(chosen, order.length - 1) + step, 0), order.length - 1));
    } else if (event.key === "Enter" && here) {
      event.preventDefault();
      add(here);
    }
  };
  const row = (each: NodeEntry) => (
    <li key={each.id} role="option" id={`palette-${each.id}`} aria-selected={each === here} draggable title={plain(each.summary)}
      ref={(element) => { if (each === here) element?.scrollIntoView({ block: "nearest" }); }}
      onDragStart={(event: DragEvent) => { event.dataTransfer.setData(DRAGGED, each.id); event.dataTransfer.effectAllowed = "copy"; }}
      onClick={() => add(each)}>
      <NodeSymbol symbol={each.symbol} /><b>{each.id}</b><small>{each.include || <Prose text={each.summary} />}</small>
    </li>
  );
  return (
    <div className="palette">
      <label className="hidden-text" htmlFor="palette-search">Search a node</label>
      <input id="palette-search" type="search" role="combobox" aria-expanded="true" aria-controls="palette-list" aria-activedescendant={here ? `palette-${here.id}` : undefined}
        placeholder="Search a node" value={search} onChange={(event) => { setSearch(event.target.value); setChosen(0); }} onKeyDown={keys} autoComplete="off" />
      <p className="muted">Enter adds {target}. Or drag a node onto the picture.</p>
      <ul id="palette-list" role="listbox" aria-label="Nodes">
        {search ? found.map(row) : groups.map((group) => <li key={group.title} role="group" aria-label={group.title}><h3 aria-hidden="true">{group.title}</h3><ul role="presentation">{group.nodes.map(row)}</ul></li>)}
      </ul>
      {!order.length && <p>No node is called so.</p>}
    </div>
  );
}

function ranked(nodes: NodeEntry[], search: string): NodeEntry[] {
  const wanted = search.trim().toLowerCase();
  if (!wanted) return nodes;
  const rank = (each: NodeEntry) => {
    const name = each.id.toLowerCase();
    return name === wanted ? 0 : name.startsWith(wanted) ? 1 : name.includes(wanted) ? 2 : each.summary.toLowerCase().includes(wanted) ? 3 : 9;
  };
  return nodes.map((each) => ({ each, rank: rank(each) })).filter(({ rank: found }) => found < 9).sort((a, b) => a.rank - b.rank).map(({ each }) => each);
}
