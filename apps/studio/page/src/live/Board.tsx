// The blackboard: keys with their values, and a change of one.

import { memo, useState } from "react";

import { Button } from "../ui/Button";
import { toast, toastError } from "../ui/Toast";

const LONG = 100; // letters above which a value may be scrolled, so that keys must reach it

// `say` is null when nothing can be changed.
export const Board = memo(function Board({ board, say }: { board: Record<string, unknown>; say: ((line: string) => Promise<string>) | null }) {
  const [edited, setEdited] = useState<{ key: string; text: string; fault: string } | null>(null);
  const keys = Object.keys(board).sort();
  if (!keys.length) return <p className="muted live-none">Nothing is written yet.</p>;
  const change = async () => {
    if (!edited || !say) return;
    try {
      const said = await say(`set ${edited.key} = ${edited.text.replaceAll("\n", " ").trim()}`);
      if (!said.includes(" is set to ")) return setEdited({ ...edited, fault: said.trim() });
      toast(said.trim(), "success");
      setEdited(null);
    } catch (error) {
      toastError(error);
    }
  };
  return (
    <dl className="live-board">
      {keys.map((key) => {
        const text = JSON.stringify(board[key]);
        const here = edited?.key === key ? edited : null;
        return (
          <div key={key} className="entry">
            <dt title={key}>{shortened(key)}</dt>
            {here ? (
              <dd>
                <form onSubmit={(event) => { event.preventDefault(); void change(); }}>
                  <input autoFocus aria-label={`New value of ${key}`} aria-invalid={here.fault ? true : undefined} value={here.text}
                    onChange={(event) => setEdited({ ...here, text: event.target.value, fault: "" })}
                    onKeyDown={(event) => { if (event.key === "Escape") setEdited(null); }} />
                  <Button type="submit" primary>Set</Button>
                  <Button onClick={() => setEdited(null)}>Cancel</Button>
                </form>
                {here.fault && <p className="fault" role="alert">{here.fault}</p>}
                <p className="muted">A value as in a mission, or {"{= an expression}"}.</p>
              </dd>
            ) : (
              <dd>
                <code tabIndex={text.length > LONG ? 0 : undefined}>{text}</code>
                {say && <button className="change" aria-label={`Change ${key}`} onClick={() => setEdited({ key, text: typeof board[key] === "string" ? (board[key] as string) : text, fault: "" })}>Change</button>}
              </dd>
            )}
          </div>
        );
      })}
    </dl>
  );
});

function shortened(key: string): string {
  const parts = key.split("/");
  return parts.length > 2 ? `…/${parts.slice(-2).join("/")}` : key;
}
