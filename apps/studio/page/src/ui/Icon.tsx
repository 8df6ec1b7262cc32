// Icons of buttons, those of the report; symbols of nodes, those of drawn trees.

import { useEffect, useRef } from "react";

import { icon } from "../../../../../analysis/report/page/src/icons.js";

export type IconName = "play" | "pause" | "back" | "on" | "failureBefore" | "failureAfter" | "link" | "done" | "theme" | "help";

export function Icon({ name }: { name: IconName }) {
  const holder = useRef<HTMLSpanElement>(null);
  useEffect(() => {
    holder.current!.replaceChildren(icon(name) as Node);
  }, [name]);
  return <span className="icon-holder" ref={holder} aria-hidden="true" />;
}

// Shapes of the symbols, of which each is one path. A `use` of the sheet in each of hundreds of cards is slow.
const paths = new Map<string, string>();

export async function loadSymbols(): Promise<void> {
  const sheet = new DOMParser().parseFromString(await (await fetch("/page/symbols.svg")).text(), "image/svg+xml");
  for (const each of sheet.querySelectorAll("symbol")) paths.set(each.id, each.querySelector("path")?.getAttribute("d") ?? "");
}

export function NodeSymbol({ symbol }: { symbol: string }) {
  return <svg className="symbol" viewBox="0 0 14 14" aria-hidden="true"><path d={paths.get(`i-${symbol}`)} /></svg>;
}
