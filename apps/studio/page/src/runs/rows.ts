// A run as the index has it.

import type { RunRow as Listed } from "../records";

export type RunRow = Listed & { id: string };

export interface IndexEvent {
  version: number;
  total: number;
  matched: number;
  complete: boolean;
  problem: string;
  rows: RunRow[];
}

// As `picktree runs` writes it: 2026-11-23 16:08, local time.
export function when(row: RunRow): string {
  const time = new Date(row.written * 1000);
  const two = (number: number) => String(number).padStart(2, "0");
  return `${time.getFullYear()}-${two(time.getMonth() + 1)}-${two(time.getDate())} ${two(time.getHours())}:${two(time.getMinutes())}`;
}

export const done = (row: RunRow) => (row.sorted === null ? "" : `${row.sorted} of ${row.total}`);
export const seconds = (value: number | null) => (value === null ? "" : `${value.toFixed(1)} s`);
