// Speed of the tool and force at the wrist over the last half minute.

import { memo, useEffect, useRef } from "react";
import UPlot from "uplot";
import "uplot/dist/uPlot.min.css";

import { colour, onTheme } from "../../../../../analysis/report/page/src/theme.js";
import type { Row } from "./state";

const SPAN = 30; // s
const KINDS = [["Speed of the tool", "m/s", 2, "running"], ["Force at the wrist", "N", 1, "failure"]] as const;

export const Plots = memo(function Plots({ rows }: { rows: Row[] }) {
  const host = useRef<HTMLDivElement>(null);
  const plots = useRef<UPlot[]>([]);
  const latest = useRef(rows);
  latest.current = rows;
  useEffect(() => {
    const element = host.current!;
    const make = () => {
      for (const plot of plots.current) plot.destroy();
      const [width, height] = [Math.max(element.clientWidth, 120), Math.max((element.clientHeight - 8) / 2, 90)];
      plots.current = KINDS.map(([title, unit, , name]) => new UPlot({
        width, height: height - 26, title: `${title}, ${unit}`, legend: { show: false }, cursor: { show: false },
        scales: { x: { time: false }, y: { range: (_, __, most) => [0, Math.max(most ?? 0, 0.01)] } },
        axes: ["x", "y"].map(() => ({ stroke: colour("muted"), grid: { stroke: colour("rim"), width: 0.5 }, ticks: { stroke: colour("rim"), width: 0.5 }, size: 38, space: 22, font: "11px sans-serif" })),
        series: [{}, { stroke: colour(name), width: 1.5, spanGaps: false }],
      }, [[], []], element));
      show(plots.current, latest.current);
    };
    onTheme(make);
    const observer = new ResizeObserver(make);
    observer.observe(element);
    return () => {
      observer.disconnect();
      for (const plot of plots.current) plot.destroy();
      plots.current = [];
    };
  }, []);
  useEffect(() => show(plots.current, rows), [rows]);
  const last = rows[rows.length - 1];
  const words = last ? `speed ${last[2]?.toFixed(2) ?? "unknown"} m/s, force ${last[1]?.toFixed(1) ?? "unknown"} N` : "no readings yet";
  return <div className="live-plots" ref={host} role="img" aria-label={`Speed and force: ${words}`} />;
});

function show(plots: UPlot[], rows: Row[]): void {
  const end = rows[rows.length - 1]?.[0] ?? 0;
  const shown = rows.filter(([time]) => time >= end - SPAN);
  const times = shown.map(([time]) => time);
  plots.forEach((plot, number) => {
    const column = KINDS[number]![2];
    plot.setData([times, shown.map((row) => row[column])]);
  });
}
