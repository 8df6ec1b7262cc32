// One run: its report at a moment, the explanation beside it, and what can be done from there.

import { useCallback, useEffect, useRef, useState } from "react";

import { onTheme } from "../../../../../analysis/report/page/src/theme.js";
import { call, useCall } from "../connection";
import { ROUTES } from "../routes";
import { href } from "../routing";
import type { Place } from "../routing";
import { Button } from "../ui/Button";
import { Empty } from "../ui/Empty";
import { Icon } from "../ui/Icon";
import { Status } from "../ui/Status";
import { toast, toastError } from "../ui/Toast";
import { Compare } from "./Compare";
import { ExplanationPanel } from "./ExplanationPanel";
import { RunJob } from "./RunJob";
import { WhatIf } from "./WhatIf";
import type { Explanation } from "./explanation";
import { done, seconds } from "./rows";
import type { RunRow } from "./rows";

export interface OpenedRun extends RunRow {
  log: string;
  mission_file?: string;
  mission_text?: string;
  faults_text?: string;
  checkpoints?: number;
  parameters?: Record<string, string>;
}

interface Moment {
  time: number;
  failure: number | null;
}

export function RunPage({ place }: { place: Place }) {
  const id = place.rest;
  const [again, setAgain] = useState(0);
  const opened = useCall<OpenedRun>("runs.open", { id }, again);
  if (opened.error) return <Empty title="This run cannot be opened"><p>{opened.error.message}</p><p><a href={href("runs")}>All runs</a></p></Empty>;
  if (!opened.value) return <p className="loading" role="status">Opening the run …</p>;
  return <Opened key={again} run={opened.value} place={place} refresh={() => setAgain(again + 1)} />;
}

const NOT_ON_A_ROBOT = "A run on a robot has no simulation that could be repeated";

function Opened({ run, place, refresh }: { run: OpenedRun; place: Place; refresh(): void }) {
  const explained = useCall<Explanation>("runs.explain", { id: run.id });
  const [moment, setMoment] = useState<Moment>({ time: Number(place.query.get("t") ?? 0) || 0, failure: null });
  const [open, setOpen] = useState<"whatif" | "compare" | null>(null);
  const [job, setJob] = useState<number | null>(null);
  const [wanted, setWanted] = useState<{ time?: number; failure?: number } | null>(null);

  // The address names the moment, so that it can be sent to somebody and found again.
  const written = useRef(place.query.get("t"));
  useEffect(() => {
    const asked = place.query.get("t");
    if (asked !== null && asked !== written.current && Number.isFinite(Number(asked))) {
      written.current = asked;
      setWanted({ time: Number(asked) });
    }
  }, [place]);
  const told = useCallback((now: Moment) => {
    setMoment(now);
    written.current = String(Number(now.time.toFixed(3)));
    history.replaceState(null, "", href("run", run.id, { t: written.current }));
  }, [run.id]);

  const start = (name: string, args: object = {}) => {
    call<number>(name, { id: run.id, ...args }).then(setJob, toastError);
  };
  const copy = () => {
    const link = `${location.origin}/${href("run", run.id, { t: Number(moment.time.toFixed(3)) })}`;
    navigator.clipboard.writeText(link).then(() => toast("Link copied", "success"), () => toast(link));
  };
  const onRobot = run.backend === "robot";
  const live = run.status === "running" && ROUTES.some((route) => route.name === "live");
  return (
    <div className="run-page">
      <header className="run-head">
        <div className="run-title">
          <h1>{run.mission || run.id} <Status status={run.status} /></h1>
          <p className="muted">{[run.scene, run.seed === null ? "" : `seed ${run.seed}`, run.backend, done(run) && `${done(run)} sorted`, seconds(run.seconds), run.lost ? `${run.lost.toFixed(1)} s lost` : ""].filter(Boolean).join(" · ")}</p>
        </div>
        <div className="buttons" role="toolbar" aria-label="From this moment">
          {live && <a className="button" href={href("live", run.id)}>Watch it live</a>}
          {run.status === "running" && <Button onClick={refresh}>Show the new part of the log</Button>}
          <Button primary onClick={() => setOpen("whatif")} disabled={onRobot || run.mission_text === undefined} title={onRobot ? NOT_ON_A_ROBOT : "Resume from the checkpoint before this moment, with a change"}>What if …</Button>
          <Button onClick={() => start("runs.resim")} disabled={onRobot} title={onRobot ? NOT_ON_A_ROBOT : "Repeat the run from its log, and compare"}>Run again</Button>
          <Button onClick={() => setOpen("compare")}>Compare …</Button>
          <Button onClick={() => start("runs.write_report")} title="The report as one file, in reports/">Write the page</Button>
          <Button onClick={() => start("runs.write_film")} title="Writes into films/">Make the film</Button>
          <Button onClick={copy} title="A link to this moment"><Icon name="link" /> Copy link</Button>
        </div>
      </header>
      {job !== null && <RunJob number={job} onClose={() => setJob(null)} />}
      <div className="run-panes">
        <Report run={run} wanted={wanted} first={moment.time} onMoment={told} />
        <aside className="beside" aria-label="Explanation">
          {explained.error ? <p className="problem" role="alert">{explained.error.message}</p>
            : explained.value ? <ExplanationPanel found={explained.value} time={moment.time} onGo={(time, failure) => setWanted(failure === null ? { time } : { time, failure })} />
              : <p className="loading" role="status"><span className="spinner" aria-hidden="true" /> Explaining the run …</p>}
        </aside>
      </div>
      {open === "whatif" && <WhatIf run={run} time={moment.time} onClose={() => setOpen(null)} />}
      {open === "compare" && <Compare run={run} onClose={() => setOpen(null)} />}
    </div>
  );
}

interface ReportProps {
  run: OpenedRun;
  // Moment to go to; a new object each time.
  wanted: { time?: number; failure?: number } | null;
  first: number;
  onMoment(moment: Moment): void;
}

// The report in a frame of its own origin: whatever is in the log, it reaches nothing of the studio.
function Report({ run, wanted, first, onMoment }: ReportProps) {
  const made = useCall<string>("runs.report", { id: run.id });
  const frame = useRef<HTMLIFrameElement>(null);
  const [ready, setReady] = useState(false);
  const start = useRef(first);
  const post = useCallback((message: object) => frame.current?.contentWindow?.postMessage({ picktree: "go", ...message }, "*"), []);
  useEffect(() => {
    const heard = (event: MessageEvent) => {
      const said = event.data as { picktree?: string; time?: unknown; failure?: unknown } | null;
      if (event.source !== frame.current?.contentWindow || said?.picktree !== "moment" || typeof said.time !== "number") return;
      setReady(true);
      onMoment({ time: said.time, failure: typeof said.failure === "number" ? said.failure : null });
    };
    addEventListener("message", heard);
    return () => removeEventListener("message", heard);
  }, [onMoment]);
  useEffect(() => {
    if (ready && wanted) post(wanted);
  }, [ready, wanted, post]);
  useEffect(() => {
    if (ready) onTheme(() => post({ theme: document.documentElement.dataset.theme }));
  }, [ready, post]);
  if (made.error) return <div className="report"><p className="problem" role="alert">{made.error.message}</p></div>;
  if (!made.value) return <div className="report"><p className="loading" role="status"><span className="spinner" aria-hidden="true" /> Making the report, once for this run …</p></div>;
  const address = made.value.split("/").map(encodeURIComponent).join("/");
  return (
    <div className="report">
      <iframe ref={frame} title={`Report of ${run.mission}`} sandbox="allow-scripts" src={`${address}#t=${start.current}`} />
    </div>
  );
}
