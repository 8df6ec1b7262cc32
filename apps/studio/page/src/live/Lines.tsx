// Lines of the log, and the last picture of each camera.

import { memo, useEffect, useRef } from "react";

import type { Line, LiveState } from "./state";

const SHOWN = 1000;
const BAD = new Set(["ERROR", "FATAL", "safety_stop", "internal_error", "budget"]);

export const Lines = memo(function Lines({ lines }: { lines: Line[] }) {
  const list = useRef<HTMLOListElement>(null);
  const atEnd = useRef(true);
  useEffect(() => {
    if (atEnd.current && list.current) list.current.scrollTop = list.current.scrollHeight;
  }, [lines]);
  return (
    <ol className="live-lines" ref={list} tabIndex={0} aria-label="Log" onScroll={({ currentTarget: shown }) => { atEnd.current = shown.scrollTop + shown.clientHeight > shown.scrollHeight - 30; }}>
      {lines.slice(-SHOWN).map(([time, kind, node, text], number) => (
        <li key={`${lines.length - Math.min(lines.length, SHOWN) + number}`} className={BAD.has(kind) ? "bad" : undefined}>
          <span className="muted">{time.toFixed(2)}</span> <b>{kind.toLowerCase()}</b> {text} {node && <small className="muted">{node.split("/").pop()}</small>}
        </li>
      ))}
      {!lines.length && <li className="muted">Nothing has happened yet.</li>}
    </ol>
  );
});

export const Cameras = memo(function Cameras({ images }: { images: LiveState["images"] }) {
  const names = Object.keys(images).sort();
  if (!names.length) return <p className="muted live-none">No camera has taken a picture yet.</p>;
  return (
    <div className="live-cameras" tabIndex={0} role="group" aria-label="Pictures of the cameras">
      {names.map((name) => (
        <figure key={name}>
          <img src={images[name]!.url} alt={`Picture of the camera ${name}`} />
          <figcaption>{name}, {images[name]!.at.toFixed(2)} s</figcaption>
        </figure>
      ))}
    </div>
  );
});
