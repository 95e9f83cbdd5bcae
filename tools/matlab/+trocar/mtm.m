classdef mtm < trocar.arm
    % A master: trocar.mtm('MTML'), see trocar.arm.

    properties (SetAccess = protected)
        gripper  % of the master
    end

    methods

        function self = mtm(name, varargin)
            % trocar:argument when it is no MTM.
            self@trocar.arm(name, varargin{:});
            self.must_be('MTM');
            self.gripper = trocar.gripper(self.bridge, name);
        end

        function lock_orientation(self, rotation)
            % Hold the tip's orientation (3x3) in the reference frame; the place stays free. In Cartesian effort mode.
            self.command('lock_orientation', trocar.internal.quaternion_of(rotation));
        end

        function lock_orientation_as_is(self)
            % Hold the orientation that the tip has now.
            self.command('lock_orientation', []);
        end

        function unlock_orientation(self)
            % Let go of it.
            self.command('unlock_orientation', []);
        end

        function result = orientation_locked(self)
            % Whether it is held.
            result = trocar.internal.reported(self.bridge, [self.name '/orientation_locked'], 'locked');
        end

    end

end
