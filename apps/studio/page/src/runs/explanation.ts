// The explanation of a run, as `picktree explain --json` prints it.

export interface Failure {
  number: number;
  time: number;
  tick: number;
  node: string;
  id: string;
  item: string;
  attempt: number;
  cause: string;
  sentence: string;
  remedy: string;
  message: string;
  fate: string;
  seconds_lost: number | null;
  because_of: number | null;
  observed: string[];
  handled_by: unknown[];
}

export interface RootCause {
  cause: string;
  title: string;
  failures: number[];
  ended_run: boolean;
  reasons: string[];
  time: number | null;
  seconds_lost: number;
  planted: string[];
  against: string[];
  account: string;
}

export interface Explanation {
  outcome: { status: string; sentence: string; end: number; items_sorted: number | null; items_total: number | null; notes: string[] };
  failures: Failure[];
  root_causes: RootCause[];
  items: { id: string; kind: string; colour: string; state: string; truth: string }[];
  look_at: { time: number; why: string; failure: number | null }[];
}
