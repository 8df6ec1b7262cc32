// A mission's file while it is written: the text, its tree, its faults, its draft. One history serves text and picture.

import type { EditorView } from "@codemirror/view";
import { useCallback, useEffect, useMemo, useRef, useState } from "react";

import { CallError, call } from "../connection";
import { toast, toastError } from "../ui/Toast";
import { applyChanges, canRedo, canUndo, makeEditor, showFaults } from "./editor";
import { Index, completed } from "./model";
import type { Edit, Edited, Mission, Palette, TextFault } from "./model";

const FAULTS_AFTER = 200; // ms
const DRAFT_AFTER = 400; // ms

interface Opened {
  text: string;
  version: string;
  draft: string | null;
}

export interface Writing {
  // Where the editor is put.
  host: React.RefObject<HTMLDivElement | null>;
  view: EditorView | null;
  text: string;
  mission: Mission | null;
  index: Index | null;
  faults: TextFault[] | null;
  palette: Palette | null;
  problem: string;
  unsaved: boolean;
  undoable: boolean;
  redoable: boolean;
  edit(edit: Edit): Promise<string | null>;
  // Resolves with whether the file has the text.
  save(): Promise<boolean>;
}

export function useMission(path: string, onCursor: (place: number) => void): Writing {
  const host = useRef<HTMLDivElement>(null);
  const [view, setView] = useState<EditorView | null>(null);
  const [text, setText] = useState("");
  const [saved, setSaved] = useState("");
  const [mission, setMission] = useState<Mission | null>(null);
  const [faults, setFaults] = useState<TextFault[] | null>(null);
  const [palette, setPalette] = useState<Palette | null>(null);
  const [problem, setProblem] = useState("");
  const state = useRef({ version: "", ends: "\n", text: "", mission: null as Mission | null });
  const cursor = useRef(onCursor);
  cursor.current = onCursor;

  // Asks for the trees of the text, or for an edit of them; contents that are here are not sent again.
  const askTrees = useCallback(<T,>(name: string, args: object): { answer: Promise<T>; show(found: Mission): void } => {
    const had = state.current.mission;
    const answer = call<T>(name, { path, ...args, known: had?.trees.map((tree) => tree.content) ?? [] }, name === "mission.tree");
    const show = (found: Mission) => {
      // A text of which nothing can be read leaves the last picture.
      state.current.mission = found.readable ? completed(found, had) : had && { ...had, whole: false };
      setMission(state.current.mission);
    };
    return { answer, show };
  }, [path]);

  const readTree = useMemo(() => oneAtATime(async () => {
    const asked = state.current.text;
    const { answer, show } = askTrees<Mission>("mission.tree", { text: asked });
    const found = await answer;
    if (asked === state.current.text) show(found);
  }), [askTrees]);

  const save = useCallback(() => {
    const now = state.current;
    const written = now.text;
    return call<{ version: string }>("files.write", { path, text: written.replaceAll("\n", now.ends), version: now.version || null }).then((file) => {
      now.version = file.version;
      setSaved(written);
      toast(`${path} saved`, "success");
      return true;
    }, (error: CallError) => {
      toastError(error);
      return false;
    });
  }, [path]);

  useEffect(() => {
    let made: EditorView | null = null;
    let wanted = true;
    const timers = { faults: 0, draft: 0 };
    const readFaults = oneAtATime(async () => {
      if (!wanted) return;
      const asked = state.current.text;
      const found = await call<TextFault[]>("mission.faults", { path, text: asked }, true);
      if (!wanted || asked !== state.current.text) return;
      setFaults(found);
      if (made) showFaults(made, found);
    });
    const readPalette = () => void call<Palette>("mission.palette", { path, text: state.current.text }, true).then((found) => wanted && setPalette(found), () => undefined);
    const keepDraft = (now: string) => void call("files.draft", { path, text: now.replaceAll("\n", state.current.ends) }, true).catch(toastError);
    call<Opened>("files.read", { path }, true).then((file) => {
      if (!wanted || !host.current) return;
      const now = state.current;
      now.version = file.version;
      now.ends = file.text.includes("\r\n") ? "\r\n" : "\n";
      const plain = (some: string) => some.replaceAll("\r\n", "\n");
      const found = plain(file.draft ?? file.text);
      now.text = found;
      setText(found);
      setSaved(plain(file.text));
      if (file.draft !== null && file.draft !== file.text) toast("The unsaved text is restored.", "info");
      made = makeEditor(host.current, path, found, {
        changed(changed, byPicture) {
          now.text = changed;
          setText(changed);
          if (!byPicture) readTree();
          clearTimeout(timers.faults);
          timers.faults = window.setTimeout(readFaults, FAULTS_AFTER);
          clearTimeout(timers.draft);
          timers.draft = window.setTimeout(() => keepDraft(changed), DRAFT_AFTER);
        },
        moved: (place) => cursor.current(place),
        save,
      });
      setView(made);
      readTree();
      readFaults();
      readPalette();
    }, (error: CallError) => wanted && setProblem(error.message));
    return () => {
      wanted = false;
      clearTimeout(timers.faults);
      if (timers.draft && made) {
        clearTimeout(timers.draft);
        keepDraft(state.current.text);
      }
      made?.destroy();
    };
  }, [path, readTree, save]);

  // The names of sub-trees in the palette are those of the text.
  const trees = mission?.trees.map((tree) => `${tree.name}(${tree.ports.map((port) => port.key).join()})`).join() ?? "";
  const first = useRef(true);
  useEffect(() => {
    if (!trees) return;
    if (first.current) {
      first.current = false;
      return;
    }
    void call<Palette>("mission.palette", { path, text: state.current.text }, true).then(setPalette, () => undefined);
  }, [path, trees]);

  // Saved by hand, or typed back: nothing is left to keep.
  const unsaved = text !== saved;
  useEffect(() => {
    if (view && !unsaved) void call("files.draft", { path, text: null }, true).catch(() => undefined);
  }, [path, unsaved, view]);

  // An edit by the picture. Resolves with the node that it concerns; null when it could not be done.
  const edit = useCallback(async (wanted: Edit): Promise<string | null> => {
    if (!view) return null;
    const asked = state.current.text;
    try {
      const { answer, show } = askTrees<Edited>("mission.edit", { text: asked, edit: wanted });
      const done = await answer;
      if (asked !== state.current.text) {
        toast("The text has changed meanwhile; try again.", "info");
        return null;
      }
      applyChanges(view, done.changes, true);
      show(done.tree);
      return done.selected;
    } catch (error) {
      toastError(error);
      return null;
    }
  }, [view, askTrees]);

  const index = useMemo(() => (mission ? new Index(mission) : null), [mission]);
  return { host, view, text, mission, index, faults, palette, problem, unsaved, undoable: Boolean(view && canUndo(view)), redoable: Boolean(view && canRedo(view)), edit, save };
}

// Asks again when the answer has come, if it was wanted meanwhile: the last text is what counts, and none waits for others.
function oneAtATime(ask: () => Promise<void>): () => void {
  let [asking, stale] = [false, false];
  return function again() {
    stale = asking;
    if (asking) return;
    asking = true;
    ask().catch(toastError).finally(() => {
      asking = false;
      if (stale) again();
    });
  };
}
