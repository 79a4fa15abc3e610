"""Rules in the three formats, the same ones."""

# Between -0.2 and 0.2 rad no rule fires where the trunk does not turn back.
FIS = """\
[System]
Name='gap'
Type='mamdani'
Version=2.0
NumInputs=2
NumOutputs=1
NumRules=3
AndMethod='min'
OrMethod='max'
ImpMethod='min'
AggMethod='max'
DefuzzMethod='centroid'
[Input1]
Name='e'
Enabled=1
Range=[-1 1]
NumMFs=2
MF1='N':'trimf',[-2 -1 -0.2]
MF2='P':'trimf',[0.2 1 2]
[Input2]
Name='e_dot'
Range=[-2 2]
NumMFs=2
MF1='N':'trimf',[-6 -2 0]
MF2='P':'trimf',[-2 2 6]
[Output1]
Name='u'
Enabled=1
Default=3
LockRange=0
LockPrevious=0
Range=[0 5]
NumMFs=2
MF1='S':'trimf',[0 1 3.5]
MF2='B':'trimf',[1.5 4 5]
[Rules]
1 1, 1 (1) : 1
2 1, 2 (0.5) : 2
1 2, 2 (1) : 1
"""
FLL = """\
Engine: gap
InputVariable: e
  enabled: true
  range: -1 1
  lock-range: true
  term: N Triangle -2 -1 -0.2
  term: P Triangle 0.2 1 2
InputVariable: e_dot
  range: -2 2
  term: N Triangle -6 -2 0
  term: P Triangle -2 2 6
OutputVariable: u
  enabled: true
  range: 0 5
  lock-range: false
  lock-previous: false
  aggregation: Maximum
  defuzzifier: Centroid 100
  default: 3
  term: S Triangle 0 1 3.5
  term: B Triangle 1.5 4 5
RuleBlock:
  enabled: true
  conjunction: Minimum
  disjunction: Maximum
  implication: Minimum
  activation: General
  rule: if e is N and e_dot is N then u is S
  rule: if e is P or e_dot is N then u is B with 0.5
  rule: if e is N and e_dot is P then u is B
"""
FCL = """\
FUNCTION_BLOCK gap
VAR_INPUT e : REAL; e_dot : REAL; END_VAR
VAR_OUTPUT u : REAL; END_VAR
FUZZIFY e
  ENABLED : TRUE; TERM N := (-1, 1) (-0.2, 0); TERM P := (0.2, 0) (1, 1); RANGE := (-1 .. 1); END_FUZZIFY
FUZZIFY e_dot TERM N := (-2, 1) (0, 0); TERM P := (-2, 0) (2, 1); END_FUZZIFY
DEFUZZIFY u
  TERM S := (0, 0) (1, 1) (3.5, 0); TERM B := (1.5, 0) (4, 1) (5, 0);
  METHOD : COG; DEFAULT := 3; ACCU : MAX; LOCK : ; RANGE := (0 .. 5);
END_DEFUZZIFY
RULEBLOCK r
  AND : MIN; OR : MAX; ACT : MIN; ACTIVATION : General; ENABLED : TRUE;
  RULE 1 : IF e IS N AND e_dot IS N THEN u IS S;
  RULE 2 : IF e IS P OR e_dot IS N THEN u IS B WITH 0.5;
  RULE 3 : IF e IS N AND e_dot IS P THEN u IS B;
END_RULEBLOCK
END_FUNCTION_BLOCK
"""
