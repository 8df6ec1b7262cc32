// The WebSocket of this page: calls, and watches that are taken up again when the connection comes back.

import { useEffect, useState, useSyncExternalStore } from "react";

export interface Fault {
  file: string;
  line: number;
  column: number;
  where: string;
  message: string;
  advice: string;
  code: string;
  severity: "error" | "warning";
  detail: string;
}

export class CallError extends Error {
  constructor(
    message: string,
    readonly faults: Fault[] = [],
  ) {
    super(message);
  }
}

interface Waiting {
  message: object;
  sent: boolean;
  repeatable: boolean;
  done(result: unknown): void;
  failed(error: CallError): void;
}

interface Watching {
  message: object;
  event(value: unknown): void;
  failed?(error: CallError): void;
  ended?(): void;
}

export type State = "connecting" | "open" | "lost";

const RETRY = 700; // ms
const calls = new Map<number, Waiting>();
const watches = new Map<number, Watching>();
const listeners = new Set<() => void>();
let socket: WebSocket | null = null;
let state: State = "connecting";
let retry = 0; // timer of the next attempt to connect
let next = 1;

function setState(wanted: State): void {
  state = wanted;
  for (const listener of listeners) listener();
}

// One socket at a time: while another attempt is due, none is made.
function connect(): void {
  if (socket || retry) return;
  const opened = new WebSocket(`ws://${location.host}/ws`);
  socket = opened;
  opened.onopen = () => {
    setState("open");
    for (const [id, call] of calls) if (!call.sent) send(id, call);
    for (const [id, watch] of watches) opened.send(JSON.stringify({ id, ...watch.message }));
  };
  opened.onmessage = (event) => receive(JSON.parse(event.data as string));
  opened.onclose = () => {
    socket = null;
    setState("lost");
    // What was asked for and not answered may have been done: it is asked again only where that does no harm.
    for (const [id, call] of calls) {
      if (!call.sent) continue;
      if (call.repeatable) {
        call.sent = false;
        continue;
      }
      calls.delete(id);
      call.failed(new CallError("the connection to the studio was lost before the answer came"));
    }
    retry = window.setTimeout(() => { retry = 0; connect(); }, RETRY);
  };
}

function send(id: number, call: Waiting): void {
  call.sent = true;
  socket!.send(JSON.stringify({ id, ...call.message }));
}

interface Answer {
  id: number;
  result?: unknown;
  event?: unknown;
  end?: boolean;
  error?: { message: string; faults?: Fault[] };
}

function receive(answer: Answer): void {
  const { id, error } = answer;
  const call = calls.get(id);
  if (call) {
    calls.delete(id);
    if (error) call.failed(new CallError(error.message, error.faults));
    else call.done(answer.result);
    return;
  }
  const watch = watches.get(id);
  if (!watch) return;
  if (error) {
    watches.delete(id);
    watch.failed?.(new CallError(error.message, error.faults));
  } else if (answer.end) {
    watches.delete(id);
    watch.ended?.();
  } else watch.event(answer.event);
}

const isOpen = () => socket?.readyState === WebSocket.OPEN;

// Calls by name; rejects with a CallError. A repeatable one is sent again when the connection was lost before its answer.
export function call<T>(name: string, args: object = {}, repeatable = false): Promise<T> {
  connect();
  return new Promise((done, failed) => {
    const waiting: Waiting = { message: { call: name, with: args }, sent: false, repeatable, done: done as (r: unknown) => void, failed };
    const id = next++;
    calls.set(id, waiting);
    if (isOpen()) send(id, waiting);
  });
}

// Watches until the returned function is called.
export function watch<T>(name: string, args: object, onEvent: (event: T) => void, onError?: (error: CallError) => void, onEnd?: () => void): () => void {
  connect();
  const id = next++;
  const message = { watch: name, with: args };
  watches.set(id, { message, event: onEvent as (e: unknown) => void, failed: onError, ended: onEnd });
  if (isOpen()) socket!.send(JSON.stringify({ id, ...message }));
  return () => {
    if (watches.delete(id) && isOpen()) socket!.send(JSON.stringify({ id, unwatch: true }));
  };
}

export function useConnection(): State {
  return useSyncExternalStore(
    (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    () => state,
  );
}

export interface Loaded<T> {
  value: T | null;
  error: CallError | null;
}

// The result of a call, asked for again when its arguments or `again` change. The old value stays until then.
export function useCall<T>(name: string, args: object, again: unknown = null): Loaded<T> {
  const [loaded, setLoaded] = useState<Loaded<T>>({ value: null, error: null });
  const key = JSON.stringify([name, args, again]);
  useEffect(() => {
    let wanted = true;
    call<T>(name, args, true).then(
      (value) => wanted && setLoaded({ value, error: null }),
      (error: CallError) => wanted && setLoaded({ value: null, error }),
    );
    return () => {
      wanted = false;
    };
    // eslint-disable-next-line react-hooks/exhaustive-deps
  }, [key]);
  return loaded;
}

// The last event of a watch.
export function useWatch<T>(name: string, args: object): Loaded<T> {
  const [loaded, setLoaded] = useState<Loaded<T>>({ value: null, error: null });
  const key = JSON.stringify([name, args]);
  useEffect(() => {
    return watch<T>(
      name,
      args,
      (value) => setLoaded({ value, error: null }),
      (error) => setLoaded((before) => ({ value: before.value, error })),
    );
    // eslint-disable-next-line react-hooks/exhaustive-deps
  }, [key]);
  return loaded;
}
