// What of a tree is drawn as a few shapes for all of its nodes: lines to the children, and from afar the cards themselves.

import { memo } from "react";

import type { TreeMarks } from "./TreeView";

export interface Outline {
  id: string;
  parent?: string;
  family: string;
  x: number;
  y: number;
  width: number;
  height: number;
}

const ROUND = 6; // px
const STEP = 20; // px from a child to where the line to it turns

export const Lines = memo(function Lines({ shown }: { shown: Outline[] }) {
  const byId = new Map(shown.map((each) => [each.id, each]));
  const path = shown.map((each) => {
    const parent = each.parent === undefined ? undefined : byId.get(each.parent);
    return parent ? line(parent.x + parent.width, parent.y + parent.height / 2, each.x, each.y + each.height / 2) : "";
  }).join("");
  return <svg className="tree-lines" aria-hidden="true"><path d={path} /></svg>;
});

function line(x: number, y: number, toX: number, toY: number): string {
  const turn = toX - STEP;
  const round = Math.min(ROUND, Math.abs(toY - y) / 2);
  if (round < 1) return `M${x} ${y}H${toX}`;
  const way = Math.sign(toY - y);
  return `M${x} ${y}H${turn - round}Q${turn} ${y} ${turn} ${y + way * round}V${toY - way * round}Q${turn} ${toY} ${turn + round} ${toY}H${toX}`;
}

export const Cards = memo(function Cards({ shown, marks, selected }: { shown: Outline[]; marks: TreeMarks; selected?: string }) {
  const paths = new Map<string, string>();
  for (const each of shown) {
    const mark = marks[each.id];
    const kind = mark?.faults ? "failure" : mark?.status && mark.status !== "idle" ? mark.status : each.family;
    paths.set(kind, (paths.get(kind) ?? "") + box(each));
  }
  const chosen = shown.find((each) => each.id === selected);
  return (
    <svg className="tree-far" aria-hidden="true">
      {[...paths].map(([kind, path]) => <path key={kind} className={kind} d={path} />)}
      {chosen && <path className="chosen" d={box(chosen)} />}
    </svg>
  );
});

const box = ({ x, y, width, height }: Outline) => `M${x} ${y}h${width}v${height}h${-width}z`;
