import type { ReactNode } from "react";

export interface ButtonProps {
  children: ReactNode;
  onClick?(): void;
  primary?: boolean;
  disabled?: boolean;
  // Why it is disabled, or what it does.
  title?: string;
  type?: "button" | "submit";
  pressed?: boolean;
  expanded?: boolean;
  className?: string;
}

export function Button({ children, onClick, primary, disabled, title, type = "button", pressed, expanded, className = "" }: ButtonProps) {
  return (
    <button type={type} className={`${primary ? "primary" : ""} ${className}`.trim() || undefined} disabled={disabled} title={title}
      aria-pressed={pressed} aria-expanded={expanded} onClick={onClick}>{children}</button>
  );
}
