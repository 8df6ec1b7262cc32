// The menu of a node in the picture.

import { useEffect, useRef } from "react";
import type { KeyboardEvent } from "react";

import type { Edit, MissionNode } from "./model";

export function NodeMenu({ at, node, parent, change, onAdd, onClose }: { at: { x: number; y: number }; node: MissionNode; parent: MissionNode | null; change(edit: Edit): void; onAdd(): void; onClose(): void }) {
  const menu = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const before = document.activeElement as HTMLElement | null;
    menu.current!.querySelector<HTMLElement>("button:enabled")?.focus();
    const outside = (event: PointerEvent) => { if (!menu.current?.contains(event.target as Node)) onClose(); };
    addEventListener("pointerdown", outside, true);
    return () => {
      removeEventListener("pointerdown", outside, true);
      if (!document.activeElement || document.activeElement === document.body) before?.focus();
    };
  }, [onClose]);
  const keys = (event: KeyboardEvent) => {
    const buttons = [...menu.current!.querySelectorAll<HTMLElement>("button:enabled")];
    const here = buttons.indexOf(document.activeElement as HTMLElement);
    if (event.key === "Escape" || event.key === "Tab") onClose();
    else if (event.key === "ArrowDown") buttons[(here + 1) % buttons.length]?.focus();
    else if (event.key === "ArrowUp") buttons[(here - 1 + buttons.length) % buttons.length]?.focus();
    else return;
    event.preventDefault();
  };
  const item = (words: string, action: () => void, disabled = false) => (
    <button role="menuitem" disabled={disabled} onClick={() => { onClose(); action(); }}>{words}</button>
  );
  const fixed = node.aliased;
  const x = Math.min(at.x, innerWidth - 230);
  const y = Math.min(at.y, innerHeight - 300);
  return (
    <div className="node-menu" role="menu" aria-label={node.name} ref={menu} style={{ left: x, top: y }} onKeyDown={keys}>
      {item("Add a node…", onAdd)}
      {["Recover", "RetryUntilSuccessful", "Timeout", "Sequence", "Fallback"].map((each) => <span key={each} role="presentation">{item(`Wrap in ${each}`, () => change({ do: "wrap", node: node.id, identity: each }), fixed)}</span>)}
      {item("Unwrap", () => change({ do: "unwrap", node: node.id }), fixed || node.children.length !== 1)}
      {item("Remove", () => change({ do: "remove", node: node.id }), fixed || !parent)}
    </div>
  );
}
