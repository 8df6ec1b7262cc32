// A labelled control with its hint and its fault.

import { useId } from "react";
import type { ReactNode } from "react";

import { Prose } from "./Prose";

export interface FieldProps {
  label: string;
  hint?: ReactNode;
  fault?: string;
  hideLabel?: boolean;
  children(attributes: { id: string; "aria-describedby"?: string; "aria-invalid"?: true }): ReactNode;
}

export function Field({ label, hint, fault, hideLabel, children }: FieldProps) {
  const id = useId();
  const below = `${id}-below`;
  return (
    <div className="field">
      <label htmlFor={id} className={hideLabel ? "hidden-text" : undefined}>{label}</label>
      {children({ id, "aria-describedby": hint || fault ? below : undefined, "aria-invalid": fault ? true : undefined })}
      {(hint || fault) && <div id={below} className={fault ? "fault" : "hint"}>{fault || (typeof hint === "string" ? <Prose text={hint} /> : hint)}</div>}
    </div>
  );
}
