MODULE CALBACK
  ! Robot side of TruePose for ABB IRC5 and OmniCore (RobotWare 6, 7): background task (non-motion,
  ! SEMISTATIC), TCP 5001. Goes with CALSRV.mod.
  ! UNTESTED ON A CONTROLLER.
  ! Answers while the motion task moves, is stopped or is in an emergency stop: 200 probe, 202 joints,
  ! 205 status, 207 stop. Stops the robot when the client is silent longer than calWatchdogS during a move.

  PERS bool calAbort:=FALSE;
  PERS num calWhy:=0;
  PERS num calWatchdogS:=0;
  PERS bool calWord:=FALSE;
  PERS bool calMoving:=FALSE;
  PERS num calErrno:=0;

  PERS string calAddress:="192.168.125.1";
  CONST num CAL_PORT:=5001;
  CONST num LOOK_S:=0.05;             ! how often the watchdog is looked at

  VAR socketdev server;
  VAR socketdev client;
  VAR bool connected:=FALSE;
  VAR string heard:="";
  VAR clock silence;

  PROC main()
    IF NOT connected listen;
    ClkReset silence;
    ClkStart silence;
    WHILE TRUE DO
      hear;
    ENDWHILE
  ERROR
    IF ERRNO=ERR_SOCK_TIMEOUT THEN
      watch;
      TRYNEXT;
    ELSEIF ERRNO=ERR_SOCK_CLOSED THEN
      SocketClose client;
      SocketClose server;
      connected:=FALSE;
      heard:="";
      watch;
      ExitCycle;
    ENDIF
  ENDPROC

  PROC listen()
    SocketCreate server;
    SocketBind server,calAddress,CAL_PORT;
    SocketListen server;
    waitForClient;
    SocketClose server;
    heard:="";
    connected:=TRUE;
  ENDPROC

  ! Nobody connected is silence as well.
  PROC waitForClient()
    SocketAccept server,client\Time:=LOOK_S;
  ERROR
    IF ERRNO=ERR_SOCK_TIMEOUT THEN
      watch;
      RETRY;
    ENDIF
  ENDPROC

  PROC watch()
    IF calWord THEN
      calWord:=FALSE;
      ClkReset silence;
      ClkStart silence;
    ENDIF
    IF calMoving AND calWatchdogS>0 AND ClkRead(silence)>calWatchdogS halt 3;
  ENDPROC

  PROC halt(num why)
    calWhy:=why;
    calAbort:=FALSE;                  ! the trap answers to a change, also to one after a stop that was missed
    calAbort:=TRUE;                   ! the trap of the motion task stops it, clears the path and frees it again
  ENDPROC

  PROC hear()
    VAR string piece;
    VAR num mark;
    SocketReceive client\Str:=piece\Time:=LOOK_S;
    calWord:=TRUE;
    watch;
    IF StrLen(heard)+StrLen(piece)>80 heard:="";
    heard:=heard+piece;
    mark:=StrFind(heard,1,"#");
    IF mark<=StrLen(heard) THEN
      answer StrPart(heard,1,mark);
      heard:="";
    ENDIF
  ENDPROC

  PROC answer(string text)
    VAR num code:=0;
    VAR num seq:=0;
    VAR num blank;
    VAR num next;
    VAR bool ok;
    VAR jointtarget here;
    blank:=StrFind(text,1," #");
    ok:=StrToVal(StrPart(text,1,blank-1),code);
    IF ok AND code=200 THEN
      send "200 1 CAL 2 5 #";
      RETURN;
    ENDIF
    next:=StrFind(text,blank+1," #");
    IF ok AND next>blank+1 ok:=StrToVal(StrPart(text,blank+1,next-blank-1),seq);
    IF NOT ok OR seq<1 OR seq>9999 THEN
      send NumToStr(code,0)+" 0 1 0 #";
      RETURN;
    ENDIF
    TEST code
    CASE 202:
      here:=CJointT(\TaskName:="T_ROB1");
      send "202 1 "+NumToStr(seq,0)+" "+NumToStr(here.robax.rax_1,5)+" "+NumToStr(here.robax.rax_2,5)+" "
        +NumToStr(here.robax.rax_3,5)+" "+NumToStr(here.robax.rax_4,5)+" "
        +NumToStr(here.robax.rax_5,5)+" "+NumToStr(here.robax.rax_6,5)+" #";
    CASE 205:
      send "205 1 "+NumToStr(seq,0)+" "+NumToStr(OpMode(),0)+" "+NumToStr(RunMode(\Main),0)+" "
        +NumToStr(DOutput(doCalMotors),0)+" "+NumToStr(DOutput(doCalEStop),0)+" "
        +flag(calMoving)+" "+NumToStr(calErrno,0)+" #";
    CASE 207:
      halt 5;
      send "207 1 "+NumToStr(seq,0)+" #";
    DEFAULT:
      send NumToStr(code,0)+" 0 9 "+NumToStr(seq,0)+" #";
    ENDTEST
  ENDPROC

  FUNC string flag(bool value)
    IF value RETURN "1";
    RETURN "0";
  ENDFUNC

  PROC send(string line)
    SocketSend client\Str:=line+"\0A";
  ENDPROC
ENDMODULE
