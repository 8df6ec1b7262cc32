// The start page: what is in the folder, and what to do first.

import { useState } from "react";

import { call, useCall } from "../connection";
import type { ListedFile } from "../records";
import { ROUTES } from "../routes";
import { href } from "../routing";
import { Button } from "../ui/Button";
import { Dialog } from "../ui/Dialog";
import { Empty } from "../ui/Empty";
import { toast, toastError } from "../ui/Toast";
import { counted } from "../ui/words";
import { LastRuns } from "../runs/LastRuns";

export interface FolderState {
  folder: string;
  name: string;
  trusted: boolean;
  files: ListedFile[];
}

const KINDS: [kind: string, many: string, what: string][] = [
  ["mission", "Missions", "what the robot does, as a tree"],
  ["scene", "Scenes", "the place of each fixture, and the spawned items"],
  ["faults", "Faults", "faults that the simulation injects"],
  ["cases", "Cases", "rehearsals of a mission"],
  ["plan", "Plans", "batches of runs"],
  ["robot", "Robots", "your own robot arms"],
];
// Routes that open a file, by its kind.
const PAGES: Record<string, string> = { mission: "write", plan: "plan" };
const SHOWN = 8;

export function Start() {
  const [again, setAgain] = useState(0);
  const { value, error } = useCall<FolderState>("folder.state", {}, again);
  if (error) return <Empty title="The folder cannot be read"><p>{error.message}</p></Empty>;
  if (!value) return <p className="loading" role="status">Looking into the folder …</p>;
  const refresh = () => setAgain(again + 1);
  const missions = value.files.filter((file) => file.kind === "mission");
  const pages = Object.fromEntries(Object.entries(PAGES).filter(([, name]) => ROUTES.some((route) => route.name === name)));
  return (
    <div className="start">
      <h1>{value.name} <small className="mono">{value.folder}</small></h1>
      {missions.length === 0 && <First refresh={refresh} />}
      <LastRuns />
      {value.files.length > 0 && (
        <div className="kinds">
          {KINDS.map(([kind, many, what]) => {
            const files = value.files.filter((file) => file.kind === kind);
            if (!files.length) return null;
            return (
              <section className="card" key={kind}>
                <h2>{many} <span className="count">{files.length}</span></h2>
                <p className="muted">{what}</p>
                <ul>
                  {files.slice(0, SHOWN).map((file) => (
                    <li key={file.path}>
                      {pages[kind] ? <a href={href(pages[kind], file.path)}>{file.path}</a> : <span className="mono">{file.path}</span>}
                      {file.name && <span className="muted"> {file.name}</span>}
                    </li>
                  ))}
                </ul>
                {files.length > SHOWN && <p className="muted">and {files.length - SHOWN} more</p>}
              </section>
            );
          })}
        </div>
      )}
      <Trust trusted={value.trusted} refresh={refresh} />
    </div>
  );
}

function First({ refresh }: { refresh(): void }) {
  const [copying, setCopying] = useState(false);
  const copy = async () => {
    setCopying(true);
    try {
      const written = await call<string[]>("folder.copy_examples");
      toast(`${counted(written.length, "file")} copied into the folder`, "success");
      refresh();
    } catch (error) {
      toastError(error);
    } finally {
      setCopying(false);
    }
  };
  return (
    <Empty title="No mission is in this folder yet">
      <p>Begin with the examples: missions, faults and cases to run, to break and to change. They are copied into this folder; files that are there stay as they are.</p>
      <p><Button primary onClick={() => void copy()} disabled={copying}>Copy the examples here</Button></p>
      <p className="muted">Or write a mission of your own: <code>picktree new mission .</code></p>
    </Empty>
  );
}

function Trust({ trusted, refresh }: { trusted: boolean; refresh(): void }) {
  const [asking, setAsking] = useState(false);
  const set = (wanted: boolean) => {
    setAsking(false);
    call("folder.trust", { trusted: wanted }).then(refresh, toastError);
  };
  return (
    <section className="card trust" aria-label="Plug-ins">
      <h2>Plug-ins</h2>
      <p>
        {trusted
          ? "Plug-ins of missions in this folder are run: Python files that may do whatever you may."
          : "Plug-ins of missions in this folder are not run: they are Python files that may do whatever you may. A mission that needs one is refused until you trust the folder."}
      </p>
      {trusted ? <Button onClick={() => set(false)}>Stop trusting it</Button> : <Button onClick={() => setAsking(true)}>Trust this folder …</Button>}
      {asking && (
        <Dialog title="Trust the plug-ins of this folder?" onClose={() => setAsking(false)}>
          <p>From now on, missions of this folder run their Python files with your rights. If the folder is from somebody else, read these files first.</p>
          <p className="buttons"><Button primary onClick={() => set(true)}>Trust this folder</Button> <Button onClick={() => setAsking(false)}>Cancel</Button></p>
        </Dialog>
      )}
    </section>
  );
}
