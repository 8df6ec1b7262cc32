// A table of many rows of one height, of which those in view are drawn. Rows come by their place.
//
// ↑ ↓ Page Home End move the chosen row, Enter opens it. Columns are sorted by their heads.

import { useCallback, useLayoutEffect, useRef, useState } from "react";
import type { KeyboardEvent, ReactNode } from "react";

export interface Column<T> {
  key: string;
  head: string;
  // Width as of a grid's column, as "90px" or "minmax(120px, 2fr)".
  width: string;
  cell(row: T): ReactNode;
  sortable?: boolean;
  number?: boolean;
  // Left out on narrow screens.
  wide?: boolean;
}

export interface TableProps<T> {
  label: string;
  columns: Column<T>[];
  count: number;
  // The row at a place; undefined while it is being fetched.
  row(index: number): T | undefined;
  keyOf(row: T): string;
  // Says which rows are in view, so that they are fetched.
  onRange?(first: number, last: number): void;
  sort?: { key: string; descending: boolean };
  onSort?(key: string): void;
  hrefOf?(row: T): string;
  onOpen?(row: T): void;
}

const HEIGHT = 34;
const MARGIN = 12;

export function Table<T>({ label, columns, count, row, keyOf, onRange, sort, onSort, hrefOf, onOpen }: TableProps<T>) {
  const scroller = useRef<HTMLDivElement>(null);
  const [view, setView] = useState({ first: 0, last: 40 });
  const [chosen, setChosen] = useState(0);
  const look = useCallback(() => {
    const element = scroller.current!;
    const first = Math.max(0, Math.floor(element.scrollTop / HEIGHT) - MARGIN);
    const last = Math.ceil((element.scrollTop + element.clientHeight) / HEIGHT) + MARGIN;
    setView((before) => (before.first === first && before.last === last ? before : { first, last }));
  }, []);
  useLayoutEffect(() => {
    const observer = new ResizeObserver(look);
    observer.observe(scroller.current!);
    return () => observer.disconnect();
  }, [look]);
  const last = Math.min(view.last, count);
  useLayoutEffect(() => onRange?.(view.first, last), [view.first, last, onRange]);

  const choose = (index: number) => {
    const wanted = Math.min(Math.max(index, 0), count - 1);
    setChosen(wanted);
    const element = scroller.current!;
    const top = wanted * HEIGHT;
    if (top < element.scrollTop) element.scrollTop = top;
    else if (top + 2 * HEIGHT > element.scrollTop + element.clientHeight) element.scrollTop = top + 2 * HEIGHT - element.clientHeight;
    look();
    requestAnimationFrame(() => element.querySelector<HTMLElement>(`[data-index="${wanted}"]`)?.focus({ preventScroll: true }));
  };
  const keys = (event: KeyboardEvent) => {
    const page = Math.max(1, Math.floor(scroller.current!.clientHeight / HEIGHT) - 2);
    const moves: Record<string, number> = { ArrowDown: chosen + 1, ArrowUp: chosen - 1, PageDown: chosen + page, PageUp: chosen - page, Home: 0, End: count - 1 };
    const to = moves[event.key];
    if (to !== undefined && count) {
      event.preventDefault();
      choose(to);
    } else if (event.key === "Enter" && !(event.target instanceof HTMLAnchorElement) && (event.target as HTMLElement).dataset.index !== undefined) {
      const found = row(chosen);
      if (found !== undefined) onOpen?.(found);
    }
  };
  const template = columns.map((column) => column.width).join(" ");
  const narrow = columns.filter((column) => !column.wide).map((column) => column.width).join(" ");
  const rows: ReactNode[] = [];
  for (let index = view.first; index < last; index++) {
    const found = row(index);
    rows.push(
      <div role="row" key={found === undefined ? `~${index}` : keyOf(found)} aria-rowindex={index + 2} data-index={index}
        tabIndex={index === Math.min(chosen, count - 1) ? 0 : -1} className="table-row" style={{ top: index * HEIGHT }}
        onFocus={() => setChosen(index)}
        onClick={(event) => { if (found !== undefined && !(event.target as HTMLElement).closest("a, button")) onOpen?.(found); }}>
        {columns.map((column, number) => (
          <div role="cell" key={column.key} className={cellClass(column)}>
            {found === undefined ? (number ? "" : "…") : hrefOf && number === 0 ? <a href={hrefOf(found)} tabIndex={-1}>{column.cell(found)}</a> : column.cell(found)}
          </div>
        ))}
      </div>,
    );
  }
  return (
    <div className="table" role="table" aria-label={label} aria-rowcount={count + 1} style={{ "--columns": template, "--narrow": narrow } as React.CSSProperties} onKeyDown={keys}>
      <div className="table-scroll" ref={scroller} onScroll={look}>
        <div role="rowgroup" className="table-heads">
          <div role="row" className="table-head" aria-rowindex={1}>
            {columns.map((column) => {
              const here = sort?.key === column.key;
              return (
                <div role="columnheader" key={column.key} className={cellClass(column)} aria-sort={here ? (sort.descending ? "descending" : "ascending") : undefined}>
                  {column.sortable ? (
                    <button onClick={() => onSort?.(column.key)}>{column.head}<span aria-hidden="true">{here ? (sort.descending ? "\u00a0↓" : "\u00a0↑") : ""}</span></button>
                  ) : column.head}
                </div>
              );
            })}
          </div>
        </div>
        <div role="rowgroup" className="table-body" style={{ height: count * HEIGHT }}>{rows}</div>
      </div>
    </div>
  );
}

function cellClass<T>(column: Column<T>): string {
  return `cell${column.number ? " number" : ""}${column.wide ? " wide-only" : ""}`;
}
