// What if: the run goes on from the checkpoint before a moment, with another mission or other faults.

import { useEffect, useRef, useState } from "react";

import { call, useCall } from "../connection";
import { JobView, useJob } from "../jobs";
import { Button } from "../ui/Button";
import { Dialog } from "../ui/Dialog";
import { Field } from "../ui/Field";
import { YamlEditor } from "../ui/YamlEditor";
import { toastError } from "../ui/Toast";
import type { OpenedRun } from "./RunPage";

type Faults = "recorded" | "none" | "edited";
const NEW_FAULTS = "picktree: 1\nkind: faults\nfaults:\n  - {fault: slip, when: {node: Grasp, start: 1}}\n";
const LATER = 400; // ms after the last key until what was typed is kept

export function WhatIf({ run, time, onClose }: { run: OpenedRun; time: number; onClose(): void }) {
  const recorded = run.mission_text ?? "";
  const [at, setAt] = useState(time.toFixed(2));
  // The mission of the run, or one of the folder's.
  const [source, setSource] = useState({ file: "", text: recorded });
  const [mission, setMission] = useDraft(`${run.id}/what-if/${source.file || "mission"}`, source.text);
  const missions = useCall<{ path: string }[]>("files.list", { kind: "mission" });
  const [faults, setFaults] = useDraft(`${run.id}/what-if/faults`, run.faults_text ?? NEW_FAULTS);
  const [kind, setKind] = useState<Faults>("recorded");
  const [number, setNumber] = useState<number | null>(null);
  const [part, setPart] = useState<"mission" | "faults">("mission");
  const job = useJob(number);
  const seconds = Number(at.replace(",", "."));
  const bad = !Number.isFinite(seconds) || seconds < 0 ? "a time in simulated seconds, as 12.5" : "";
  const changed = mission !== source.text;
  const choose = (file: string) => {
    if (!file) setSource({ file, text: recorded });
    else call<{ text: string }>("files.read", { path: file }).then(({ text }) => setSource({ file, text: text.replaceAll("\r\n", "\n") }), toastError);
    setPart("mission");
  };
  const start = () => {
    call<number>("runs.whatif", {
      id: run.id,
      at: seconds,
      mission: changed ? mission : null,
      mission_file: source.file,
      faults: kind === "edited" ? faults : null,
      no_faults: kind === "none",
    }).then(setNumber, toastError);
  };
  return (
    <Dialog title="What if" onClose={onClose} wide>
      <div className="whatif">
        <div className="whatif-head">
          <Field label="From" fault={bad} hint={run.checkpoints ? `the last of ${run.checkpoints} checkpoints before this time` : "the log has no checkpoint: from its beginning"}>
            {(attributes) => <input {...attributes} inputMode="decimal" value={at} onChange={(event) => setAt(event.target.value)} />}
          </Field>
          <Field label="Mission from">
            {(attributes) => (
              <select {...attributes} value={source.file} onChange={(event) => choose(event.target.value)}>
                <option value="">the run, as recorded</option>
                {missions.value?.map(({ path }) => <option key={path}>{path}</option>)}
              </select>
            )}
          </Field>
          <fieldset>
            <legend>Faults from the checkpoint on</legend>
            {([["recorded", "as recorded"], ["none", "none"], ["edited", "as written below"]] as [Faults, string][]).map(([value, text]) => (
              <label key={value}><input type="radio" name="faults" checked={kind === value} onChange={() => { setKind(value); setPart(value === "edited" ? "faults" : "mission"); }} /> {text}</label>
            ))}
          </fieldset>
        </div>
        {kind === "edited" && (
          <div className="buttons" role="group" aria-label="Text to edit">
            <Button pressed={part === "mission"} onClick={() => setPart("mission")}>Mission</Button>
            <Button pressed={part === "faults"} onClick={() => setPart("faults")}>Faults</Button>
          </div>
        )}
        {part === "mission"
          ? <YamlEditor key="mission" label="Mission" text={mission} onChange={setMission} />
          : <YamlEditor key="faults" label="Faults" text={faults} onChange={setFaults} />}
        <div className="buttons">
          <Button primary onClick={start} disabled={Boolean(bad) || job?.ended === null}>Go on from there</Button>
          {changed && <Button onClick={() => setMission(source.text)}>{source.file ? "The mission as it is" : "The mission as recorded"}</Button>}
          <span className="muted note">{changed ? "The mission is changed; the changed text is written as a new file beside it." : source.file ? `${source.file} is unchanged.` : "The mission is as recorded."}</span>
        </div>
        {job && <JobView key={job.number} job={job} output />}
      </div>
    </Dialog>
  );
}

// Text that the server keeps while it is typed, so that nothing is lost when the page or the server ends.
function useDraft(path: string, first: string): [string, (text: string) => void] {
  const [text, setText] = useState(first);
  const timer = useRef<ReturnType<typeof setTimeout>>(undefined);
  const touched = useRef(false);
  useEffect(() => {
    let wanted = true;
    touched.current = false;
    setText(first);
    call<string | null>("files.drafted", { path }).then((kept) => {
      if (wanted && kept !== null && !touched.current) setText(kept);
    }, () => undefined);
    return () => { wanted = false; };
    // `first` changes with the path.
    // eslint-disable-next-line react-hooks/exhaustive-deps
  }, [path]);
  const set = (now: string) => {
    touched.current = true;
    setText(now);
    clearTimeout(timer.current);
    timer.current = setTimeout(() => void call("files.draft", { path, text: now === first ? null : now }, true).catch(toastError), LATER);
  };
  return [text, set];
}
