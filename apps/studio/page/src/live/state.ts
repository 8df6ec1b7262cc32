// What is known of one run that goes on, kept up to date by the events of `live.follow`.

import { useEffect, useRef, useState } from "react";

import { watch } from "../connection";
import type { CallError } from "../connection";

export type Status = "IDLE" | "RUNNING" | "SUCCESS" | "FAILURE" | "SKIPPED";
export type Pose = [x: number, y: number, z: number, qx: number, qy: number, qz: number, qw: number];

export interface LiveNode {
  path: string;
  id: string;
  name: string;
  symbol: string;
  children: string[];
}

export interface Body {
  id: string;
  kind: string;
  colour: string;
  role: string;
  place: string;
  held: boolean;
  look: string;
  pose: Pose;
}

export interface Breakpoint {
  number: number;
  path: string;
  when: "before" | "after";
}

// Time, s; force at the wrist, N; speed of the tool, m/s.
export type Row = [time: number, force: number | null, speed: number | null];
export type Line = [time: number, kind: string, node: string, text: string];
export type Transition = [time: number, path: string, status: Status, subject: string, cause: string, message: string];

export interface LiveState {
  run?: { mission: string; scene: string; robot: string; seed: number; backend: string };
  time: number;
  wall?: number;
  tree: LiveNode[];
  progress?: { text: string; done: number; total: number; figures: string };
  stop?: { where: string; path: string; when: "before" | "after" | "tick" } | null;
  question?: { node: string; reason: string; situation: string; choices: string[] } | null;
  breakpoints: Breakpoint[];
  belief: Body[];
  truth: Body[];
  status?: string;
  ended?: boolean;
  nodes: Record<string, [status: Status, ticked: boolean, message: string, cause: string]>;
  board: Record<string, unknown>;
  frames: Record<string, Pose>;
  looks: Record<string, string>;
  images: Record<string, { at: number; url: string }>;
  rows: Row[];
  lines: Line[];
  transitions: Transition[];
}

const TABLES = ["nodes", "board", "frames", "looks", "images"] as const;
const LISTS = { rows: 3000, lines: 1000, transitions: 8000 } as const;

function nothing(): LiveState {
  return { time: 0, tree: [], breakpoints: [], belief: [], truth: [], nodes: {}, board: {}, frames: {}, looks: {}, images: {}, rows: [], lines: [], transitions: [] };
}

type Event = Partial<LiveState> & { whole?: boolean };

// The state after an event. What an event does not name stays the same object, so that views know it.
export function after(state: LiveState, event: Event): LiveState {
  if (event.whole) return { ...nothing(), ...event };
  const next: LiveState = { ...state, ...event };
  for (const name of TABLES) if (event[name]) Object.assign(next, { [name]: { ...state[name], ...event[name] } });
  for (const name of Object.keys(LISTS) as (keyof typeof LISTS)[]) {
    const fresh = event[name];
    if (fresh) Object.assign(next, { [name]: [...state[name], ...fresh].slice(-LISTS[name]) });
  }
  return next;
}

export interface Followed {
  state: LiveState | null;
  error: CallError | null;
}

// Drawn at most once a frame, however many events come.
export function useLive(id: string): Followed {
  const [shown, setShown] = useState<Followed>({ state: null, error: null });
  const latest = useRef<LiveState | null>(null);
  useEffect(() => {
    let asked = 0;
    const draw = () => {
      asked ||= requestAnimationFrame(() => {
        asked = 0;
        setShown({ state: latest.current, error: null });
      });
    };
    const leave = watch<Event>("live.follow", { id }, (event) => {
      latest.current = after(latest.current ?? nothing(), event);
      if (event.wall) document.documentElement.dataset.lag = String(Math.round(Date.now() - event.wall * 1000));
      draw();
    }, (error) => setShown((before) => ({ state: before.state, error })));
    return () => {
      leave();
      cancelAnimationFrame(asked);
    };
  }, [id]);
  return shown;
}
