// Icons of buttons, those of the report; symbols of nodes, those of drawn trees.

import { useEffect, useRef } from "react";

import { icon } from "../../../../analysis/report/page/src/icons.js";

export type IconName = "play" | "pause" | "back" | "on" | "failureBefore" | "failureAfter" | "link" | "done" | "theme" | "help";

export function Icon({ name }: { name: IconName }) {
  const holder = useRef<HTMLSpanElement>(null);
  useEffect(() => {
    holder.current!.replaceChildren(icon(name) as Node);
  }, [name]);
  return <span className="icon-holder" ref={holder} aria-hidden="true" />;
}

export function NodeSymbol({ symbol }: { symbol: string }) {
  return <svg className="symbol" viewBox="0 0 14 14" aria-hidden="true"><use href={`/page/symbols.svg#i-${symbol}`} /></svg>;
}
