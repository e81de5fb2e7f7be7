"""Small files of every format as text, for tests that change them."""

TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "100\t100\t3\t2\tcm\t100\t1\t3\n"
    "Frame#\tTime\tA\t\t\tB\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    "\n"
    "1\t0.00\t10\t20\t30\t\t\t\n"
    "2\t0.01\t11\t2.1e1\t31\tNaN\tnan\tNAN\n"
    "3\t0.02\t12\t22\t32\t1\t2\t3\n"
)
MOTIVE = (
    "Format Version,1.23,Take Name,T,Capture Frame Rate,120,Export Frame Rate,60,Length Units,Millimeters\n"
    "\n"
    ",Type,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker,Marker,Marker,Marker\n"
    ",Name,R,R,R,R:A,R:A,R:A,R:B,R:B,R:B\n"
    ",ID,1,1,1,2,2,2,3,3,3\n"
    ",,Position,Position,Position,Position,Position,Position,Position,Position,Position\n"
    "Frame,Time (Seconds),X,Y,Z,X,Y,Z,X,Y,Z\n"
    "0,0.0,9,9,9,1,2,3,4,5,6\n"
    "1,0.0167,9,9,9,1,2,3,,,\n"
)
QUALISYS = (
    "NO_OF_FRAMES\t3\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t2\nFREQUENCY\t200\nNO_OF_ANALOG\t0\nANALOG_FREQUENCY\t0\n"
    "DESCRIPTION\t--\nTIME_STAMP\t2022-06-02, 15:49:44.620\t25975.4\nDATA_INCLUDED\t3D\n"
    "MARKER_NAMES\tL Hand\tHead\n"
)
BVH = """HIERARCHY
ROOT mixamorig:Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Left Leg
  {
    OFFSET 0.1 -0.5 0
    CHANNELS 3 Yrotation Xrotation Zrotation
    End Site
    {
      OFFSET 0 -0.6 0
    }
  }
  JOINT Slider
  {
    OFFSET 0 0.5 0
    CHANNELS 6 Xposition Yposition Zposition Xrotation Yrotation Zrotation
    End Site
    {
      OFFSET 0 0.2 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
1 2 3 10 20 30 40 50 60 0 0.5 0 1 2 3
1 2 4 11 21 31 41 51 61 0 0.7 0 4 5 6
"""
ASF = """# made for this test
:version 1.10
:units
  mass 1.0
  length 0.5
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name lhipjoint
    direction 1 0 0
    length 2
    axis 0 0 0 XYZ
  end
  begin
    id 2
    name lfemur
    direction 0 -1 0
    length 10
    axis 0 0 30 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
    id 3
    name ltibia
    direction 0 -3 0
    length 8
    axis 0 0 30 XYZ
    dof rx
  end
:hierarchy
  begin
    root lhipjoint
    lhipjoint lfemur
    lfemur ltibia
  end
"""
AMC = """#!OML:ASF test
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 10 20 30
lfemur 5 15 25
ltibia 40
2
root 1 2 4 10 20 30
lfemur 5 15 25
ltibia 41
"""
