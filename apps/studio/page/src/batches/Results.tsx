// Results of a batch: rates with their intervals, causes as a Pareto chart, the table as a heat map.

import type { Asked, BatchSummary, Breakdown, Rate } from "./values";
import { hourly, percent, words } from "./values";
import { counted } from "../ui/words";

export function Results({ summary, label, onAsk }: { summary: BatchSummary; label: string; onAsk(asked: Asked): void }) {
  const part: Breakdown = (label && summary.by_recipe[label]) || summary;
  return (
    <div className="results">
      <section className="card wide">
        <h2>Goal reached</h2>
        <p className="muted">Share of jobs, with Wilson's 95 % interval.</p>
        <Rates rows={summary.recipes.map((recipe) => ({ name: recipe.label, rate: recipe.success, more: hourly(recipe.figures) }))}
          onAsk={(name) => onAsk({ what: "all", value: "", label: name, title: `Jobs of ${name}` })} />
      </section>
      <section className="card">
        <h2>Causes of failures</h2>
        <p className="muted">The most frequent first; the share adds them up.</p>
        <Pareto part={part} onAsk={(cause) => onAsk({ what: "cause", value: cause, label, title: `Jobs with ${cause}` })} />
      </section>
      <section className="card">
        <h2>Root causes</h2>
        <p className="muted">By the explanation of each job; what cost the goal most often first.</p>
        {part.roots.length === 0 && <p>No root cause was found.</p>}
        <ul className="bars">
          {part.roots.map((root) => (
            <li key={root.cause}>
              <button onClick={() => onAsk({ what: "root", value: root.cause, label, title: `Jobs with the root cause ${root.cause}` })}>
                <code>{root.cause}</code> <span>{counted(root.jobs, "job")}, {root.missed} missed the goal</span>
              </button>
              {root.look_at && <p className="muted">{root.look_at}</p>}
            </li>
          ))}
        </ul>
      </section>
      <section className="card">
        <h2>Share sorted by place</h2>
        <p className="muted">Where items arrived, from above, the robot below. A number counts those that were not sorted; choose it for their jobs.</p>
        <HeatMap summary={summary} part={part} onAsk={(value, title) => onAsk({ what: "place", value, label, title })} />
      </section>
      <section className="card">
        <h2>Share sorted by form and colour</h2>
        <p className="muted">Share of items sorted, with Wilson's 95 % interval.</p>
        <Rates rows={part.forms.map((each) => ({ name: each.label, rate: each.rate }))} onAsk={(name) => onAsk({ what: "form", value: name, label, title: `Jobs that left a ${name}` })} />
        <Rates rows={part.colours.map((each) => ({ name: each.label, rate: each.rate }))} onAsk={(name) => onAsk({ what: "colour", value: name, label, title: `Jobs that left something ${name}` })} />
      </section>
    </div>
  );
}

function Rates({ rows, onAsk }: { rows: { name: string; rate: Rate; more?: string }[]; onAsk(name: string): void }) {
  return (
    <ul className="bars rates">
      {rows.filter((row) => row.rate.total).map(({ name, rate, more }) => (
        <li key={name}>
          <button onClick={() => onAsk(name)}>
            <span className="rate-name">{name}</span>
            <span className="interval" aria-hidden="true">
              <i style={{ left: `${100 * rate.low}%`, width: `${100 * (rate.high - rate.low)}%` }} />
              <b style={{ left: `${(100 * rate.successes) / rate.total}%` }} />
            </span>
            <span className="rate-words">{words(rate)}{more ? `, ${more}` : ""}</span>
          </button>
        </li>
      ))}
    </ul>
  );
}

function Pareto({ part, onAsk }: { part: Breakdown; onAsk(cause: string): void }) {
  const total = part.causes.reduce((sum, row) => sum + row.failures, 0);
  const most = part.causes[0]?.failures ?? 1;
  let sum = 0;
  if (!total) return <p>Nothing failed.</p>;
  return (
    <ul className="bars pareto">
      {part.causes.map((row) => {
        sum += row.failures;
        return (
          <li key={row.cause}>
            <button onClick={() => onAsk(row.cause)}>
              <code>{row.cause}</code>
              <span className="pareto-bar" aria-hidden="true">
                <i className="good" style={{ width: `${(100 * row.cured) / most}%` }} />
                <i className="bad" style={{ width: `${(100 * (row.failures - row.cured - row.done_instead)) / most}%` }} />
              </span>
              <span>{counted(row.failures, "failure")}, {row.cured} cured{row.done_instead > 0 && `, ${row.done_instead} done instead`}, in {counted(row.jobs, "job")}; together {percent(sum / total)}</span>
            </button>
          </li>
        );
      })}
    </ul>
  );
}

function HeatMap({ summary, part, onAsk }: { summary: BatchSummary; part: Breakdown; onAsk(value: string, title: string): void }) {
  const side = summary.cell;
  if (!summary.places.length) return <p>No item's place is known.</p>;
  // One frame for all recipes, so that they can be compared.
  const xs = summary.places.map((place) => Math.round(place.x / side));
  const ys = summary.places.map((place) => Math.round(place.y / side));
  const [far, right, left] = [Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const columns = left - right + 1;
  return (
    <div className="heat" style={{ gridTemplateColumns: `repeat(${columns}, minmax(22px, 44px))` }}>
      {part.places.map((place) => {
        const missed = place.rate.total - place.rate.successes;
        const share = missed / place.rate.total;
        const title = `x ${place.x.toFixed(2)} m, y ${place.y.toFixed(2)} m: ${missed} of ${place.rate.total} not sorted`;
        const style = {
          gridRow: far - Math.round(place.x / side) + 1,
          gridColumn: left - Math.round(place.y / side) + 1,
          background: `color-mix(in srgb, var(--failure) ${Math.round(12 + 43 * share)}%, var(--sheet))`,
        };
        return missed
          ? <button key={`${place.x} ${place.y}`} style={style} title={title} aria-label={title} onClick={() => onAsk(`${place.x} ${place.y}`, title)}>{missed}</button>
          : <span key={`${place.x} ${place.y}`} style={{ ...style, background: undefined }} title={title} />;
      })}
    </div>
  );
}
