// A batch as the server tells it.

export interface Rate {
  successes: number;
  total: number;
  share?: number | null;
  low: number;
  high: number;
}

// A value with its interval; null: the counts leave it open.
export interface Estimate {
  value: number | null;
  low: number | null;
  high: number | null;
}

// The operators' figures of one run, or of several together.
export interface Figures {
  units_an_hour: Estimate;
  failures_an_hour: Estimate;
  assists_an_hour: Estimate;
  mtbf: Estimate;
  mtbf_a: Estimate;
  first_pass_yield: Rate;
  utilisation: Record<string, Estimate>;
}

export interface BatchRow {
  id: string;
  name: string;
  backend?: string;
  keep?: string;
  running?: boolean;
  total?: number;
  done?: number;
  success?: number;
  counts?: Record<string, number>;
  cpu_seconds_a_job?: number | null;
  problem?: string;
}

export interface BatchProgress extends Required<Omit<BatchRow, "problem">> {
  jobs: { number: number; label: string; seed: number; status: string }[];
}

export interface Breakdown {
  causes: { cause: string; failures: number; cured: number; done_instead: number; jobs: number; seconds_lost: number }[];
  roots: { cause: string; jobs: number; missed: number; seed: number; label: string; look_at: string }[];
  forms: { label: string; rate: Rate }[];
  colours: { label: string; rate: Rate }[];
  places: { x: number; y: number; rate: Rate }[];
}

export interface BatchSummary extends Breakdown {
  total: number;
  waiting: number;
  cell: number;
  recipes: { label: string; success: Rate; items: Rate; first_try: Rate; crashed: number; figures: Figures }[];
  by_recipe: Record<string, Breakdown>;
}

export interface JobBehind {
  job: string;
  number: number;
  label: string;
  seed: number;
  status: string;
  sorted: number | null;
  items: number | null;
  seconds: number | null;
  look_at: string;
  run: string;
}

export type What = "all" | "status" | "cause" | "root" | "place" | "form" | "colour";

export interface Asked {
  what: What;
  value: string;
  // Recipe; empty: of all.
  label: string;
  title: string;
}

const percent = (share: number) => `${(100 * share).toFixed(share > 0 && share < 0.0995 ? 1 : 0)} %`;

// As the commands write it: 7 of 8 (52.9 … 97.8 %).
export function words(rate: Rate): string {
  if (!rate.total) return "none";
  return `${rate.successes} of ${rate.total} (${(100 * rate.low).toFixed(1)} … ${(100 * rate.high).toFixed(1)} %)`;
}

// As the commands write it: 360 units an hour, MTBF 4 min.
export function hourly(figures: Figures): string {
  const { units_an_hour: units, mtbf } = figures;
  if (units.value === null) return "";
  const between = mtbf.value === null ? "no failure" : `MTBF ${duration(mtbf.value)}`;
  return `${units.value.toFixed(0)} units an hour, ${between}`;
}

export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined) return "unknown";
  if (seconds < 120) return `${seconds.toFixed(0)} s`;
  return seconds < 7200 ? `${(seconds / 60).toFixed(0)} min` : `${(seconds / 3600).toFixed(1)} h`;
}

export { percent };
