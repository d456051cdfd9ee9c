MODULE CALSRV
  ! Robot side of TruePose for ABB IRC5 and OmniCore (RobotWare 6, 7): motion task (T_ROB1), TCP 5000.
  ! UNTESTED ON A CONTROLLER. Written from the published description of the protocol and of RAPID.
  ! First trial: manual mode, reduced speed, hand on the enabling device, empty cell. It moves there as in automatic
  ! mode, at 250 mm/s at most; in manual mode at full speed nothing moves.
  !
  ! Needs: options PC Interface and Multitasking; CALBACK.mod in a second, non-motion task (TCP 5001);
  !        a system output "Emergency Stop" named doCalEStop and one "Motors On" named doCalMotors.
  ! Program version 2. Requests: "<code> <p1> ... <pn> #". Codes 0, 4 and 98 answer as open_abb does, without end
  ! mark; 2 is refused, for nothing moves here on one request. Codes from 200 echo a sequence number 1..9999 and end
  ! with " #" and a line feed:
  !   good     "<code> 1 <seq> <data> #"
  !   refused  "<code> 0 <errno> <seq> #"   1 parameters, 2 range, 3 stopped, 4 mode or motors,
  !                                         5 interrupted, 6 not the target that was sent,
  !                                         7 the configuration does not tell the joint limits, 9 unknown code
  ! A move takes two requests. 201 brings the target, which is kept and shown back; nothing moves. 209 brings the sum
  ! that the client has of its request 201. Only when it is that of the request as it arrived here does the robot
  ! move, once: a target that was damaged on its way moves nothing.
  ! An emergency stop or a supervision stop silences this task; CALBACK goes on answering. A stop that CALBACK was
  ! asked for is made here, in a trap: StartMove has to come from the task that ordered StopMove.

  ! Shared with CALBACK, same names and types there.
  PERS bool calAbort:=FALSE;          ! set by CALBACK: stop asked for, or watchdog ran out
  PERS num calWhy:=0;                 ! 5 stop asked for, 3 watchdog
  PERS num calWatchdogS:=0;           ! 0: off
  PERS bool calWord:=FALSE;           ! a request came in: feeds the watchdog
  PERS bool calMoving:=FALSE;
  PERS num calErrno:=0;

  PERS tooldata calTool:=[TRUE,[[0,0,0],[1,0,0,0]],[2.7,[50,25,100],[1,0,0,0],0,0,0]];
  PERS wobjdata calWobj:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PERS speeddata calSpeed:=[100,50,0,0];
  PERS string calAddress:="192.168.125.1";
  CONST num CAL_PORT:=5000;

  VAR socketdev server;
  VAR socketdev client;
  VAR intnum abortInterrupt;
  VAR bool armedInterrupt:=FALSE;
  VAR bool connected:=FALSE;
  VAR string heard:="";               ! received, not yet used: a request may come in pieces
  VAR num code:=0;
  VAR num params{10};
  VAR num nParams:=0;
  VAR num heardSum:=0;                ! of the request in hand
  VAR jointtarget kept;               ! target of the last 201
  VAR num keptSum:=-1;                ! of that request; -1: there is no target to go to
  VAR num pendingSeq:=0;              ! of a 209 that was interrupted
  VAR num settleS:=0;
  VAR num upperDeg{6};                ! joint limits of the controller's configuration
  VAR num lowerDeg{6};
  VAR bool limitsRead:=FALSE;

  PROC main()
    calAbort:=FALSE;                  ! one that came while this task was stopped is over
    IF NOT limitsRead readLimits;
    IF NOT armedInterrupt THEN
      CONNECT abortInterrupt WITH aborted;
      IPers calAbort,abortInterrupt;
      armedInterrupt:=TRUE;
    ENDIF
    ConfL\Off;
    SingArea\Wrist;
    calMoving:=FALSE;
    keptSum:=-1;
    IF NOT connected listen;
    IF pendingSeq>0 THEN
      ! Here after ExitCycle in the trap: the move of this number ended before its target.
      refuse 209,calWhy,pendingSeq;
      pendingSeq:=0;
    ENDIF
    WHILE TRUE DO
      hear;
      answer;
    ENDWHILE
  ERROR
    IF ERRNO=ERR_SOCK_CLOSED OR ERRNO=ERR_SOCK_TIMEOUT THEN
      calErrno:=ERRNO;
      hangUp;
      ExitCycle;
    ENDIF
  ENDPROC

  TRAP aborted
    IF calAbort THEN
      calAbort:=FALSE;
      StopMove\Quick;
      ClearPath;
      StartMove;
      calMoving:=FALSE;
      IF pendingSeq>0 ExitCycle;
    ENDIF
  ENDTRAP

  PROC listen()
    SocketCreate server;
    SocketBind server,calAddress,CAL_PORT;
    SocketListen server;
    SocketAccept server,client\Time:=WAIT_MAX;
    ! One client: nobody else is accepted while this one is served.
    SocketClose server;
    heard:="";
    connected:=TRUE;
  ENDPROC

  PROC hangUp()
    SocketClose client;
    SocketClose server;
    connected:=FALSE;
    heard:="";
  ENDPROC

  ! One whole request up to "#" into code and params.
  PROC hear()
    VAR string piece;
    VAR num mark;
    mark:=StrFind(heard,1,"#");
    WHILE mark>StrLen(heard) DO
      SocketReceive client\Str:=piece\Time:=WAIT_MAX;
      IF StrLen(heard)+StrLen(piece)>80 THEN
        heard:="";                    ! longer than any request: a string holds 80 characters
      ENDIF
      heard:=heard+piece;
      mark:=StrFind(heard,1,"#");
    ENDWHILE
    calWord:=TRUE;
    heardSum:=sumOf(StrPart(heard,1,mark));
    parse StrPart(heard,1,mark);
    IF mark<StrLen(heard) THEN
      heard:=StrPart(heard,mark+1,StrLen(heard)-mark);
    ELSE
      heard:="";
    ENDIF
  ENDPROC

  ! Fletcher's sum modulo 251: any one character that is wrong changes it, and it fits a num.
  FUNC num sumOf(string text)
    VAR num low:=0;
    VAR num high:=0;
    FOR i FROM 1 TO StrLen(text) DO
      low:=(low+StrToByte(StrPart(text,i,1)\Char)) MOD 251;
      high:=(high+low) MOD 251;
    ENDFOR
    RETURN 256*high+low;
  ENDFUNC

  ! nParams = -1: not a request.
  PROC parse(string text)
    VAR num at:=1;
    VAR num blank;
    VAR num value;
    VAR string word;
    VAR bool good;
    nParams:=-1;
    WHILE at<=StrLen(text) DO
      blank:=StrFind(text,at," #");
      IF blank>at THEN
        word:=StrPart(text,at,blank-at);
        good:=StrToVal(word,value);
        IF NOT good OR nParams=10 THEN
          nParams:=-1;
          RETURN;
        ENDIF
        IF nParams=-1 THEN
          code:=value;
          nParams:=0;
        ELSE
          nParams:=nParams+1;
          params{nParams}:=value;
        ENDIF
      ENDIF
      at:=blank+1;
    ENDWHILE
  ENDPROC

  PROC answer()
    VAR jointtarget here;
    VAR robtarget pose;
    IF nParams=-1 THEN
      refuse code,1,0;
      RETURN;
    ENDIF
    TEST code
    CASE 0:
      old nParams=0,"";
    CASE 4:
      old nParams=0,joints(2);
    CASE 98:
      old nParams=0,GetSysInfo(\SerialNo)+"*"+GetSysInfo(\SWVersion)+"*"+GetSysInfo(\RobotType);
    CASE 99:
      hangUp;
      ExitCycle;
    CASE 200:
      send "200 1 CAL 2 5 #";
    CASE 201:
      keptSum:=-1;
      IF nParams<>7 THEN
        refuse 201,1,sequence();
      ELSEIF limitFault()<>0 THEN
        refuse 201,limitFault(),params{1};
      ELSE
        kept:=asked(2);
        keptSum:=heardSum;
        good 201,params{1},shown(kept,5);
      ENDIF
    CASE 209:
      IF nParams<>2 THEN
        refuse 209,1,sequence();
      ELSEIF keptSum<0 OR params{2}<>keptSum THEN
        keptSum:=-1;
        refuse 209,6,params{1};
      ELSEIF (OpMode()<>OP_AUTO AND OpMode()<>OP_MAN_PROG) OR DOutput(doCalMotors)=0 THEN
        refuse 209,4,params{1};
      ELSE
        keptSum:=-1;                  ! one go, one move
        pendingSeq:=params{1};
        move;
        pendingSeq:=0;
        good 209,params{1},"";
      ENDIF
    CASE 202:
      IF nParams<>1 THEN
        refuse 202,1,sequence();
      ELSE
        WaitTime settleS;
        good 202,params{1},joints(5);
      ENDIF
    CASE 203:
      pose:=CRobT(\Tool:=calTool\WObj:=calWobj);
      good 203,sequence(),NumToStr(pose.trans.x,4)+" "+NumToStr(pose.trans.y,4)+" "+NumToStr(pose.trans.z,4);
    CASE 206:
      IF nParams=2 THEN
        settleS:=params{2};
        good 206,params{1},"";
      ELSE
        refuse 206,1,sequence();
      ENDIF
    CASE 208:
      ! Watchdog ms, speed mm/s, speed deg/s; shown back, so that the client sees what it set.
      IF nParams<>4 OR params{2}<0 OR params{3}<=0 OR params{4}<=0 THEN
        refuse 208,1,sequence();
      ELSE
        calWatchdogS:=params{2}/1000;
        calSpeed.v_tcp:=params{3};
        calSpeed.v_ori:=params{4};
        good 208,params{1},NumToStr(params{2},0)+" "+NumToStr(params{3},1)+" "+NumToStr(params{4},1);
      ENDIF
    DEFAULT:
      IF code<100 THEN
        old FALSE,"";
      ELSE
        refuse code,9,sequence();
      ENDIF
    ENDTEST
  ENDPROC

  FUNC num sequence()
    IF nParams>0 RETURN params{1};
    RETURN 0;
  ENDFUNC

  PROC move()
    calMoving:=TRUE;
    MoveAbsJ kept\NoEOffs,calSpeed,fine,calTool\WObj:=calWobj;
    WaitRob\ZeroSpeed;
    calMoving:=FALSE;
  ENDPROC

  FUNC jointtarget asked(num first)
    VAR jointtarget target;
    target:=CJointT();                ! keeps external axes where they are
    target.robax.rax_1:=params{first};
    target.robax.rax_2:=params{first+1};
    target.robax.rax_3:=params{first+2};
    target.robax.rax_4:=params{first+3};
    target.robax.rax_5:=params{first+4};
    target.robax.rax_6:=params{first+5};
    RETURN target;
  ENDFUNC

  ! Radians there, degrees here. CalcRobT would not tell: it raises nothing for joints outside their limits.
  PROC readLimits()
    VAR num bound;
    FOR i FROM 1 TO 6 DO
      ReadCfgData "/MOC/ARM/rob1_"+NumToStr(i,0),"upper_joint_bound",bound;
      upperDeg{i}:=bound*180/pi;
      ReadCfgData "/MOC/ARM/rob1_"+NumToStr(i,0),"lower_joint_bound",bound;
      lowerDeg{i}:=bound*180/pi;
    ENDFOR
    limitsRead:=TRUE;
  ERROR
    RETURN;
  ENDPROC

  ! Of the target in params: 0 within the limits, 2 outside, 7 they are not known.
  FUNC num limitFault()
    IF NOT limitsRead RETURN 7;
    FOR i FROM 1 TO 6 DO
      IF params{i+1}<lowerDeg{i} OR params{i+1}>upperDeg{i} RETURN 2;
    ENDFOR
    RETURN 0;
  ENDFUNC

  FUNC string joints(num decimals)
    RETURN shown(CJointT(),decimals);
  ENDFUNC

  FUNC string shown(jointtarget at,num decimals)
    RETURN NumToStr(at.robax.rax_1,decimals)+" "+NumToStr(at.robax.rax_2,decimals)+" "
      +NumToStr(at.robax.rax_3,decimals)+" "+NumToStr(at.robax.rax_4,decimals)+" "
      +NumToStr(at.robax.rax_5,decimals)+" "+NumToStr(at.robax.rax_6,decimals);
  ENDFUNC

  PROC old(bool ok,string data)
    IF ok THEN
      SocketSend client\Str:=NumToStr(code,0)+" 1 "+data;
    ELSE
      SocketSend client\Str:=NumToStr(code,0)+" 0 ";
    ENDIF
  ENDPROC

  PROC good(num which,num seq,string data)
    IF data="" THEN
      send NumToStr(which,0)+" 1 "+NumToStr(seq,0)+" #";
    ELSE
      send NumToStr(which,0)+" 1 "+NumToStr(seq,0)+" "+data+" #";
    ENDIF
  ENDPROC

  PROC refuse(num which,num number,num seq)
    send NumToStr(which,0)+" 0 "+NumToStr(number,0)+" "+NumToStr(seq,0)+" #";
  ENDPROC

  PROC send(string line)
    SocketSend client\Str:=line+"\0A";
  ENDPROC
ENDMODULE
