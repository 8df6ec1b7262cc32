// The runs that were written last, on the start page.

import { useWatch } from "../connection";
import { href } from "../routing";
import { Status } from "../ui/Status";
import { done, when } from "./rows";
import type { IndexEvent } from "./rows";

export function LastRuns() {
  const { value } = useWatch<IndexEvent>("runs.index", { count: 6 });
  if (!value) return null;
  return (
    <section className="card last-runs">
      <h2><a href={href("runs")}>Runs</a> <span className="count">{value.total}</span></h2>
      {value.total === 0 ? (
        <p className="muted">No run yet. <code>picktree run MISSION --seed 0</code> makes one, and it appears here.</p>
      ) : (
        <ul>
          {value.rows.map((row) => (
            <li key={row.id}>
              <Status status={row.status} /> <a href={href("run", row.id)}>{row.mission || row.folder}</a>{" "}
              <span className="muted">{[row.seed === null ? "" : `seed ${row.seed}`, done(row), row.cause, when(row)].filter(Boolean).join(" · ")}</span>
            </li>
          ))}
        </ul>
      )}
    </section>
  );
}
