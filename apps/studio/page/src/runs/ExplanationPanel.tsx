// Why the run ended as it did. Each failure, cause and moment leads to its place in the report beside it.

import { FATE_WORDS } from "../../../../../analysis/report/page/src/words.js";
import type { Explanation, Failure, RootCause } from "./explanation";

const MOMENTS = 6;
const FATES: Record<string, string> = FATE_WORDS;
const FATE_SIGNS: Record<string, string> = { cured: "✓", done_instead: "→", passed_over: "→", branched: "→", ended: "✗", open: "?" };

export interface ExplanationPanelProps {
  found: Explanation;
  // Time of the report, s; the failure before it is marked.
  time: number;
  onGo(time: number, failure: number | null): void;
}

export function ExplanationPanel({ found, time, onGo }: ExplanationPanelProps) {
  const { outcome, root_causes: roots, look_at: moments, failures } = found;
  const here = failures.reduce((best, each) => (each.time <= time + 1e-6 ? each.number : best), -1);
  const go = (number: number) => {
    const failure = failures[number];
    if (failure) onGo(failure.time, number);
  };
  return (
    <div className="explanation">
      <p className={`sentence ${outcome.status}`}>{outcome.sentence}</p>
      {outcome.notes.map((note) => <p className="note" key={note}>{note}</p>)}
      {roots.length > 0 && (
        <section aria-label="Root causes">
          <h2>{roots.length > 1 ? "Root causes" : "Root cause"}</h2>
          <ol className="roots">{roots.map((root, place) => <Root key={place} root={root} go={go} />)}</ol>
        </section>
      )}
      {moments.length > 0 && (
        <section aria-label="Look at">
          <h2>Look at</h2>
          <ul className="moments">
            {moments.slice(0, MOMENTS).map((moment, place) => (
              <li key={place}><button onClick={() => onGo(moment.time, moment.failure)}><time>{moment.time.toFixed(2)} s</time><span>{moment.why}</span></button></li>
            ))}
          </ul>
        </section>
      )}
      <section aria-label="Failures">
        <h2>{failures.length ? `Failures` : "No failure"}{failures.length > 0 && <span className="count">{failures.length}</span>}</h2>
        <ol className="failures">{failures.map((failure) => <FailureCard key={failure.number} failure={failure} current={failure.number === here} go={go} />)}</ol>
      </section>
      <Items items={found.items} />
    </div>
  );
}

function Root({ root, go }: { root: RootCause; go(number: number): void }) {
  return (
    <li>
      <p><code>{root.cause}</code>{root.ended_run && <b className="status failure"> ✗ cost the goal</b>}</p>
      <p className="title">{root.title}</p>
      <p className="muted account">{root.account}</p>
      {root.reasons.map((reason, place) => <p className="muted" key={place}>{reason}</p>)}
      {root.against.map((reason, place) => <p className="muted against" key={`against ${place}`}>against it: {reason}</p>)}
      {root.planted.length > 0 && <p className="muted">Planted: {root.planted.join("; ")}</p>}
      {root.failures.length > 0 && (
        <p className="numbers"><span className="muted">{root.failures.length > 1 ? "failures" : "failure"}</span> {root.failures.map((number) => (
          <button key={number} aria-label={`Failure ${number + 1}`} onClick={() => go(number)}>{number + 1}</button>
        ))}</p>
      )}
    </li>
  );
}

function FailureCard({ failure, current, go }: { failure: Failure; current: boolean; go(number: number): void }) {
  const lost = failure.seconds_lost;
  return (
    <li className={current ? "current" : undefined}>
      <button className="failure" aria-current={current ? "true" : undefined} onClick={() => go(failure.number)}>
        <span className="line"><b>{failure.number + 1}</b> <code>{failure.cause || "failure"}</code> <time>{failure.time.toFixed(2)} s</time></span>
        <span className="line">{failure.id}{failure.item && ` ${failure.item}`}{failure.attempt > 1 && `, attempt ${failure.attempt}`}</span>
        {failure.message && <span className="muted">{failure.message}</span>}
        <span className={`fate ${failure.fate}`}><span aria-hidden="true">{FATE_SIGNS[failure.fate] ?? "·"}</span> {FATES[failure.fate] ?? failure.fate}{lost ? `, ${lost.toFixed(1)} s` : ""}</span>
      </button>
      {(failure.observed.length > 0 || failure.remedy) && (
        <details>
          <summary>why</summary>
          <p>{failure.sentence}{failure.remedy && ` What helps: ${failure.remedy}.`}</p>
          {failure.because_of !== null && <p>This failure follows from failure {failure.because_of + 1}.</p>}
          {failure.observed.map((sentence, place) => <p key={place}>{sentence}</p>)}
        </details>
      )}
    </li>
  );
}

function Items({ items }: { items: Explanation["items"] }) {
  if (!items.length) return null;
  return (
    <details className="items">
      <summary>Items <span className="count">{items.length}</span></summary>
      <ul>{items.map((item) => <li key={item.id}><b>{item.id}</b> {item.state}{item.truth && <span className="muted"> · {item.truth}</span>}</li>)}</ul>
    </details>
  );
}
